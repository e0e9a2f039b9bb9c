//! A scene in motion: what its moving parts change of a scene in a device's memory, made once for all devices.
//!
//! **Scenes that move.** Animations, skins and morph targets are evaluated in `f64` from the file's own keys
//! and vertices, for the time at which a frame is seen, the same for all of its views. What moves is the last
//! part of the mesh, and each moving part (a primitive placed by a node, or one on a skin) has a tree of its
//! own. For each frame its vertices are made anew on the host, its boxes follow from the leaves up, and the
//! few nodes above all parts, the top, are built anew; what does not move is one more part below the top,
//! whose tree stays. Nodes, vertices in leaf order, normals and tangents of the moving parts, moving lights,
//! and emitters with their tree (refitted too) are then written over what devices have. A state holds all
//! that ever differs, so that a device which has missed some, or was opened anew, needs the newest alone, and
//! pictures are the same however they are split. Where rays visit 8 % more of a part's tree than when it was
//! built, a new one is built in a thread of its own from where the part is then (`src/trace/rebuild.rs`), and
//! taken after a number of frames that its triangles alone decide, so that runs repeat; parts that shine keep
//! their trees. Kernels know nothing of it, and scenes in which nothing moves pay nothing. A still picture
//! goes another way: the file is read as it is at that time, with one tree over all, which is what tests
//! compare moving frames with. Rules: a part of which some vertex is not finite at an instant stays where it
//! was; a triangle that motion has flattened gets a millionth of the scene's size as its width, since a line
//! of no area would be met by rays that miss it; winding is that of the first instant; what is no part of the
//! scene at the first instant, since it is not finite there, never comes. Triangles and instances of what moves as
//! a whole say so by a number (`src/scene/animation/movers.rs`), by which reuse over time finds where each surface
//! point was in the last frame (`point_before` in `kernels/accumulate.wgsl`), those of a skin by the number of the joint that
//! they follow most, as if nothing was morphed; beyond 127 numbers light begins anew in each frame. The cache of light forgets five times as fast. More than eight lights are chosen among by
//! a tree, into which one that is dark at first never comes. What keeps its form and has many triangles is an instance of
//! a shape instead (`src/scene/instanced.rs`): a matrix and a door in the top, nothing else, are made anew. Skinned
//! and morphed parts are deformed by devices themselves where that is wanted: see `src/trace/deform.rs`.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use super::deform::{Deformation, Deformed, runs_of};
use super::emitters::MovingEmitters;
use super::moving_instances::MovingInstances;
use super::moving_lit::Lit;
use super::moving_looks::Looks;
use super::moving_materials::MovingMaterials;
use super::moving_parts::PartsState;
use super::rebuild::Rebuild;
use super::scene_buffers::{Moved, pack_lights, pack_material_of, pack_triangle};
use crate::bvh::compact::compact_nodes;
use crate::bvh::parted::solid;
use crate::bvh::wide::LeafSlot;
use crate::bvh::{Parted, Trees};
use crate::layout::{self, pack_normal};
use crate::scene::animation::{Instant, Motion, Movers};
use crate::scene::{Light, Scene, emitters};

/// Who deforms skinned and morphed parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeformedBy {
    /// The host, once for all devices, which get triangles and boxes.
    Host,
    /// Each device, from matrices and weights.
    Devices,
}

/// A scene's moving parts at an instant that goes on.
#[derive(Debug)]
pub struct MovingScene {
    motion: Arc<Motion>,
    movers: Movers,
    /// Where the nodes beyond the skeleton's are, or were last, and whether what hangs on them is shown.
    given: Vec<(DMat4, bool)>,
    /// Where hands have put what they can seize, if they have.
    put: Vec<Option<DMat4>>,
    /// Nothing is shown at all that moves.
    rests: bool,
    anchor: DVec3,
    parted: Parted,
    /// Triangles of each part in terms of its own vertices.
    own: Arc<Vec<Vec<[u32; 3]>>>,
    /// Of the moving triangles, in terms of the moving vertices.
    triangles: Vec<[u32; 3]>,
    first_triangle: usize,
    first_vertex: usize,
    /// Of the moving vertices.
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<[f32; 4]>,
    /// All of the scene's lights, those first that are asked everywhere.
    lights: Vec<Light>,
    order: Vec<usize>,
    emitters: Option<MovingEmitters>,
    instances: Option<MovingInstances>,
    materials: Option<MovingMaterials>,
    lit: Option<Lit>,
    /// How wide triangles are at least that motion has flattened, in metres.
    width: f32,
    serial: u64,
    /// Of each part the last instant at which its triangles came elsewhere; the first one, until they do.
    changed: Vec<u64>,
    rebuild: Rebuild,
    /// Some part has another tree than at first.
    rebuilt: bool,
    /// What kernels know of each moving triangle's material.
    packed: Vec<u32>,
    /// Parts that devices deform.
    deformation: Option<Deformation>,
    /// Ranges of the others.
    runs: Vec<Range<usize>>,
    /// Parts that shine: kernels find emitters by their places, so that their trees stay.
    shining: Vec<bool>,
}

/// Everything that differs at an instant from how the scene was packed. Each holds all of it, so that a device which
/// has missed some needs the newest alone.
#[derive(Debug, Default)]
pub struct SceneState {
    /// Tells one from the next, from 1 on.
    pub serial: u64,
    /// Nothing of it moves or is shown.
    pub(super) rests: bool,
    /// The tree's first nodes.
    pub(super) top: Vec<layout::WideNode>,
    compact_top: OnceLock<Vec<layout::CompactNode>>,
    /// Parts that the host has brought there.
    pub(super) parts: Vec<PartsState>,
    /// Whether each part is hidden.
    pub(super) hidden: Vec<bool>,
    /// The serial of the instant at which the triangles of each part came to their places, in space or in leaf order.
    pub(super) changed: Vec<u64>,
    /// Those that devices bring there.
    pub(super) deformed: Option<Deformed>,
    /// All punctual lights, where some move.
    pub(super) lights: Vec<layout::Light>,
    /// All emitters and the tree over them, where some move.
    pub(super) emitters: Vec<layout::Emitter>,
    pub(super) light_nodes: Vec<layout::LightNode>,
    /// All materials, where some change.
    pub(super) materials: Vec<layout::Material>,
    /// Moving instances from a place on.
    pub(super) instances: (usize, Vec<layout::Instance>),
    /// The box around all that is lit, where there are unlit surfaces too.
    pub(super) lit: Option<[Vec3; 2]>,
    movers: Arc<[Option<DMat4>]>,
}

impl MovingScene {
    /// The moving parts of a scene, where it has any, whose trees are `parted` and with all others `trees`.
    pub fn new(scene: &Scene, trees: Trees, parted: &Parted, by: DeformedBy) -> Option<Self> {
        let (motion, mesh) = (scene.motion.as_ref()?, &scene.mesh);
        let (first_vertex, first_triangle) = (motion.first_vertex(mesh), motion.first_triangle(mesh));
        let relative = |triangle: &[u32; 3]| triangle.map(|vertex| vertex - first_vertex as u32);
        let size = scene.bounds().map_or(0.0, |(low, high)| (high - low).max_element());
        let tangents = if mesh.tangents.is_empty() { &[][..] } else { &mesh.tangents[first_vertex..] };
        let moved = Moved::of(scene);
        let mut moving = MovingScene {
            given: motion.given.iter().map(|&place| (place, false)).collect(),
            put: Vec::new(),
            rests: false,
            anchor: scene.anchor,
            parted: parted.clone(),
            own: Arc::new(motion.own_triangles(mesh)),
            triangles: mesh.triangles[first_triangle..].iter().map(relative).collect(),
            first_triangle,
            first_vertex,
            positions: mesh.positions[first_vertex..].to_vec(),
            normals: mesh.normals[first_vertex..].to_vec(),
            tangents: tangents.iter().map(|tangent| tangent.to_array()).collect(),
            lights: scene.lights.clone(),
            order: super::emitters::lights_in_order(scene),
            emitters: MovingEmitters::of(scene, motion, trees.world),
            instances: MovingInstances::of(scene, trees),
            materials: MovingMaterials::of(scene, motion),
            lit: Lit::of(scene, first_triangle),
            width: size * 1e-6,
            serial: 0,
            // Whoever deforms parts may round otherwise than was packed.
            changed: vec![1; motion.parts.len()],
            rebuild: Rebuild::default(),
            rebuilt: false,
            packed: (first_triangle..mesh.triangles.len())
                .map(|index| pack_material_of(scene, &moved, index))
                .collect(),
            shining: motion.parts.iter().map(|part| shines(scene, part.triangles.start)).collect(),
            deformation: None,
            runs: runs_of(&vec![false; motion.parts.len()], false),
            motion: motion.clone(),
            movers: moved.movers(),
        };
        if by == DeformedBy::Devices {
            moving.leave_to_devices();
        }
        Some(moving)
    }

    /// Lets devices deform what they can from now on.
    fn leave_to_devices(&mut self) {
        let motion = self.motion.clone();
        let pose = motion.pose(motion.start, &motion.given, &[]);
        let may = |part: usize| !self.shining[part];
        let triangles = |parts| self.triangles(parts);
        let made = Deformation::of(&motion, (&pose, self.anchor), may, &self.parted, triangles, self.width);
        let Some(mut deformation) = made else { return };
        deformation.take(&motion, &pose, self.anchor, &mut self.parted);
        let left: Vec<bool> = (0..motion.parts.len()).map(|part| deformation.has(part)).collect();
        self.runs = runs_of(&left, false);
        if let Some(lit) = &mut self.lit {
            lit.leave(&motion, &left);
        }
        self.deformation = Some(deformation);
    }

    /// The time for which the scene was loaded, in seconds since its animations began.
    pub fn start(&self) -> f64 {
        self.motion.start
    }

    /// Whether some part has had a new tree, since motion had made its first one slow.
    pub fn is_rebuilt(&self) -> bool {
        self.rebuilt
    }

    /// Puts what hangs on the nodes beyond the skeleton's where it is given, from the next instant on; what is nowhere, or
    /// not at a finite place, is not shown.
    pub fn give(&mut self, places: &[Option<DMat4>]) {
        for (own, place) in self.given.iter_mut().zip(places) {
            let place = place.filter(|place| place.is_finite());
            *own = (place.unwrap_or(own.0), place.is_some());
        }
    }

    /// Has what hands can seize ([`Motion::grabbable`], in its order) where they have put it, from the next instant on.
    pub fn put(&mut self, places: &[Option<DMat4>]) {
        self.put.clear();
        self.put.extend_from_slice(places);
    }

    /// Whether the next instant is as the last one was, at whatever time: nothing moves by itself, and nothing is given a
    /// place.
    pub fn rests(&self) -> bool {
        self.rests && self.is_empty()
    }

    fn is_empty(&self) -> bool {
        let motion = &self.motion;
        let by_itself = motion.parts_before_given() + motion.rigid.len();
        by_itself + motion.lights.len() + motion.materials.len() == 0 && !self.given.iter().any(|own| own.1)
    }

    /// Everything at a time, in seconds since the animations began.
    pub fn at(&mut self, time: f64) -> SceneState {
        self.serial += 1;
        let given: Vec<DMat4> = self.given.iter().map(|own| own.0).collect();
        self.rests = self.is_empty();
        let motion = self.motion.clone();
        let pose = motion.pose(time, &given, &self.put);
        for (index, part) in motion.parts.iter().enumerate() {
            let of_given = part.node.checked_sub(motion.skeleton.nodes());
            self.parted.hide(index, of_given.map_or(pose.hides(part.node), |own| !self.given[own].1));
        }
        let (parted, deformation) = (&self.parted, self.deformation.as_ref());
        let is_left = |part: usize| deformation.is_some_and(|deformation| deformation.has(part));
        // What is not seen need not be where it would be.
        let by_host = |part: usize| !parted.is_hidden(part) && !is_left(part);
        let instant = motion.with(pose, self.anchor, &self.own, &by_host);
        self.take(&instant);
        if let Some(deformation) = &mut self.deformation {
            let moved = deformation.take(&motion, &instant.pose, self.anchor, &mut self.parted);
            moved.into_iter().for_each(|part| self.changed[part] = self.serial);
        }
        let materials = self.materials.as_mut().map(|materials| materials.at(&self.motion, &instant.pose));
        if let Some(instances) = &self.instances {
            self.parted.place(instances.doors());
        }
        let (positions, triangles) = (&self.positions, &self.triangles);
        let (first_triangle, width) = (self.first_triangle as u32, self.width);
        let corners = |triangle: u32| {
            let own = triangles[(triangle - first_triangle) as usize];
            solid(own.map(|vertex| positions[vertex as usize]), width)
        };
        let refit = |parted: &mut Parted| -> Vec<Vec<f32>> {
            self.runs.iter().map(|run| parted.refit(run.clone(), corners)).collect()
        };
        let mut leaves = refit(&mut self.parted);
        let looks = Looks {
            motion: &motion,
            pose: &instant.pose,
            anchor: self.anchor,
            own: &self.own,
            positions,
            first_vertex: self.first_vertex,
            deformation: self.deformation.as_ref(),
            width,
        };
        let look = |parted: &Parted, part: usize, most: f64| {
            (!self.shining[part]).then(|| looks.at(parted, part, most)).flatten()
        };
        let own = |part: usize| (motion.parts[part].triangles.start, motion.parts[part].triangles.len());
        if let Some(part) = self.rebuild.look_after(self.serial, &mut self.parted, look, own) {
            self.rebuilt = true;
            self.changed[part] = self.serial;
            leaves = refit(&mut self.parted);
            if let Some(mut deformation) = self.deformation.take() {
                deformation.replaced(part, &self.parted, |parts| self.triangles(parts));
                self.deformation = Some(deformation);
            }
        }
        let (emitters, light_nodes) = match &mut self.emitters {
            Some(emitters) => {
                let hidden = self.motion.hidden_triangles(&instant.pose);
                let is_hidden = |triangle| hidden.iter().any(|own| own.contains(&(triangle as usize)));
                // What has no area sheds no light.
                let seen = |triangle| if is_hidden(triangle) { [Vec3::ZERO; 3] } else { corners(triangle) };
                emitters.at(seen, &self.lights)
            }
            None => Default::default(),
        };
        let top = self.parted.top();
        SceneState {
            serial: self.serial,
            rests: self.rests,
            deformed: self.deformation.as_ref().map(|deformation| deformation.at(&top)),
            top: top.nodes,
            compact_top: OnceLock::new(),
            parts: self.runs.iter().zip(leaves).map(|(run, leaves)| self.state_of(run, leaves)).collect(),
            hidden: (0..motion.parts.len()).map(|part| self.parted.is_hidden(part)).collect(),
            changed: self.changed.clone(),
            lights: if self.motion.lights.is_empty() {
                Vec::new()
            } else {
                pack_lights(&self.lights, &self.order)
            },
            emitters,
            light_nodes,
            materials: materials.unwrap_or_default(),
            instances: self.instances.as_ref().map(MovingInstances::records).unwrap_or_default(),
            movers: self.movers.places(&instant.pose).into(),
            lit: self.lit.as_ref().and_then(|lit| lit.bounds(corners, &self.parted, self.instances.as_ref())),
        }
    }

    /// Parts that the host has brought to an instant, with their vertices in leaf order.
    fn state_of(&self, run: &Range<usize>, leaves: Vec<f32>) -> PartsState {
        let (trees, parts) = (&self.parted.parts[run.clone()], &self.motion.parts[run.clone()]);
        let (Some(tree), Some(first), Some(last)) = (trees.first(), parts.first(), parts.last()) else {
            return PartsState::default();
        };
        let vertices = first.vertices.start - self.first_vertex..last.vertices.end - self.first_vertex;
        let normals = self.normals[vertices.clone()].par_iter().map(|n| pack_normal(n.to_array()));
        PartsState {
            nodes: (tree.first_node, trees.iter().flat_map(|part| &part.nodes).copied().collect()),
            leaves: (tree.first_place * 9, leaves),
            triangles: (
                tree.first_place,
                if self.rebuilt { self.triangles(run.clone()) } else { Vec::new() },
            ),
            normals: (first.vertices.start, normals.collect()),
            tangents: (
                first.vertices.start,
                self.tangents.get(vertices).map_or_else(Vec::new, <[_]>::to_vec),
            ),
            compact: OnceLock::new(),
        }
    }

    /// The triangles of a range of parts in leaf order.
    fn triangles(&self, parts: Range<usize>) -> Vec<layout::Triangle> {
        let pack = |slot: &LeafSlot| {
            let own = (slot.triangle as usize) - self.first_triangle;
            let vertices = self.triangles[own].map(|vertex| vertex + self.first_vertex as u32);
            pack_triangle(vertices, self.packed[own], slot)
        };
        self.parted.parts[parts].iter().flat_map(|part| part.order.iter().map(pack)).collect()
    }

    /// Takes an instant's vertices and lights in.
    fn take(&mut self, instant: &Instant) {
        let first = self.first_vertex;
        for ((part, vertices), changed) in self.motion.parts.iter().zip(&instant.parts).zip(&mut self.changed)
        {
            // What is not finite stays where it was.
            let Some(vertices) = vertices else { continue };
            let range = part.vertices.start - first..part.vertices.end - first;
            if self.positions[range.clone()] != vertices.positions[..] {
                *changed = self.serial;
            }
            self.positions[range.clone()].copy_from_slice(&vertices.positions);
            self.normals[range.clone()].copy_from_slice(&vertices.normals);
            let all = self.tangents.get_mut(range).into_iter().flatten();
            all.zip(&vertices.tangents).for_each(|(to, tangent)| *to = tangent.to_array());
        }
        if let Some(instances) = &mut self.instances {
            instances.take(&instant.rigid);
        }
        instant.apply_lights(&self.motion, &mut self.lights);
    }
}

impl SceneState {
    /// Where what moves as a whole is: `world_from_part` in metres by the number that records have of it, less one.
    pub fn movers(&self) -> &Arc<[Option<DMat4>]> {
        &self.movers
    }

    /// The compact forms of the top, made for the first device that asks.
    pub(super) fn compact_top(&self) -> &[layout::CompactNode] {
        self.compact_top.get_or_init(|| compact_nodes(&self.top))
    }
}

/// Whether a triangle sends light of its own.
pub(super) fn shines(scene: &Scene, triangle: usize) -> bool {
    emitters::shines(&scene.materials[scene.mesh.materials[triangle] as usize])
}
