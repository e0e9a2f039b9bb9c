//! Moving parts that a device deforms itself, in its memory.

use std::sync::Arc;

use super::SceneBuffers;
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, Program};
use crate::layout::{Influence, Morph, RestVertex};
use crate::trace::deform::{Deformed, DeviceTrees, Rest};
use crate::trace::kernels::{DeformVertices, FitNodes, Grid, PlaceTriangles};

/// Work-items in a group, and vertices or nodes for each.
const GROUP: usize = 64;

/// The kernels that do it.
#[derive(Debug)]
pub(in crate::trace) struct DeformKernels {
    deform_vertices: DeformVertices,
    place_triangles: PlaceTriangles,
    fit_nodes: FitNodes,
}

/// What they need beside the scene.
#[derive(Debug)]
pub(super) struct DeformedBuffers {
    /// What `vertices`, `influences` and `morphs` hold.
    rest: Arc<Rest>,
    vertices: Buffer<RestVertex>,
    influences: Buffer<Influence>,
    morphs: Buffer<Morph>,
    joints: Buffer<f32>,
    weights: Buffer<f32>,
    /// Of all moving vertices: three floats each.
    positions: Buffer<f32>,
    /// What the scene's nodes and triangles are those of, and `nodes` lists.
    trees: Option<Arc<DeviceTrees>>,
    nodes: Buffer<u32>,
    top: Buffer<u32>,
    /// Of the top's nodes and the moving ones: six floats each.
    boxes: Buffer<f32>,
}

impl DeformKernels {
    pub fn of(program: &Program) -> Result<Self> {
        Ok(DeformKernels {
            deform_vertices: DeformVertices::of(program)?,
            place_triangles: PlaceTriangles::of(program)?,
            fit_nodes: FitNodes::of(program)?,
        })
    }
}

impl DeformedBuffers {
    fn new(device: &Device, state: &Deformed) -> Result<Self> {
        let (rest, trees) = (&state.rest, &state.trees);
        Ok(DeformedBuffers {
            rest: rest.clone(),
            vertices: Buffer::from_slice(device, &rest.vertices)?,
            influences: Buffer::from_slice(device, &rest.influences)?,
            morphs: Buffer::from_slice(device, &rest.morphs)?,
            joints: Buffer::new(device, state.joints.len() * 12)?,
            weights: Buffer::new(device, state.weights.len())?,
            positions: Buffer::new(device, rest.moving * 3)?,
            trees: None,
            nodes: Buffer::new(device, trees.moving.len())?,
            top: Buffer::new(device, trees.top)?,
            boxes: Buffer::new(device, (trees.top + trees.moving.len()) * 6)?,
        })
    }
}

impl DeformedBuffers {
    fn bytes(&self) -> usize {
        let rest = self.vertices.bytes() + self.influences.bytes() + self.morphs.bytes();
        let state = self.joints.bytes() + self.weights.bytes() + self.positions.bytes();
        rest + state + self.nodes.bytes() + self.top.bytes() + self.boxes.bytes()
    }
}

impl SceneBuffers {
    /// Bytes of what the device needs beside the scene to deform moving parts: 0 until it has done so.
    pub fn deformed_bytes(&self) -> usize {
        self.deformed.as_ref().map_or(0, DeformedBuffers::bytes)
    }

    /// Has the device deform moving parts, and fit their trees and the top, which is there already.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device refuses.
    pub(in crate::trace) fn deform(
        &mut self,
        device: &Device,
        kernels: &DeformKernels,
        state: &Deformed,
    ) -> Result<()> {
        let known = self.deformed.take().filter(|own| Arc::ptr_eq(&own.rest, &state.rest));
        let mut own = match known {
            Some(own) => own,
            None => DeformedBuffers::new(device, state)?,
        };
        if !own.trees.as_ref().is_some_and(|trees| Arc::ptr_eq(trees, &state.trees)) {
            self.plant(&state.trees)?;
            own.nodes.write(&state.trees.nodes)?;
            own.trees = Some(state.trees.clone());
        }
        own.joints.write(bytemuck::cast_slice(&state.joints))?;
        own.weights.write(&state.weights)?;
        own.top.write(&state.nodes)?;
        own.boxes.write(bytemuck::cast_slice(&state.boxes))?;
        self.place(kernels, &own, state)?;
        self.fit(kernels, &own, (&own.nodes, &state.trees.ends), &state.trees)?;
        self.fit(kernels, &own, (&own.top, &state.ends), &state.trees)?;
        self.deformed = Some(own);
        Ok(())
    }

    /// Writes the parts' nodes and triangles, whose boxes and corners are to be fitted.
    fn plant(&self, trees: &DeviceTrees) -> Result<()> {
        for run in &trees.runs {
            if let Some(wide) = &self.wide {
                wide.write_at(run.first_node, &run.nodes)?;
            }
            if let Some(compact) = &self.compact {
                compact.write_at(run.first_node, run.compact())?;
            }
            self.triangles.write_at(run.first_place, &run.triangles)?;
        }
        Ok(())
    }

    /// Vertices, and triangles in leaf order.
    fn place(&self, kernels: &DeformKernels, own: &DeformedBuffers, state: &Deformed) -> Result<()> {
        let first_vertex = own.rest.first_vertex as u32;
        let count = own.rest.vertices.len() - 1;
        kernels.deform_vertices.launch(
            Grid { items: count, group: GROUP },
            &own.vertices,
            count as u32,
            &own.influences,
            &own.morphs,
            &own.weights,
            &own.joints,
            first_vertex,
            &own.positions,
            &self.normals,
            self.tangents.as_ref(),
        )?;
        for run in &state.trees.runs {
            kernels.place_triangles.launch(
                Grid { items: run.triangles.len(), group: GROUP },
                &self.triangles,
                run.first_place as u32,
                run.triangles.len() as u32,
                &own.positions,
                first_vertex,
                &state.width,
                &self.leaves,
            )?;
        }
        Ok(())
    }

    /// Nodes, level by level.
    fn fit(
        &self,
        kernels: &DeformKernels,
        own: &DeformedBuffers,
        (list, ends): (&Buffer<u32>, &[usize]),
        trees: &DeviceTrees,
    ) -> Result<()> {
        let mut first = 0;
        for &end in ends {
            if end > first {
                kernels.fit_nodes.launch(
                    Grid { items: end - first, group: GROUP },
                    self.wide.as_ref(),
                    self.compact.as_ref(),
                    list,
                    first as u32,
                    (end - first) as u32,
                    &self.leaves,
                    trees.top as u32,
                    trees.moving.start as u32,
                    &own.boxes,
                )?;
            }
            first = end;
        }
        Ok(())
    }
}
