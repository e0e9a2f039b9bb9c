//! What a device has of a scene, read back: for those who want to know what its kernels have made of it.

use super::SceneBuffers;
use crate::error::Result;
use crate::gpu::opencl::Buffer;
use crate::layout;

/// What rays walk, and what vertices have; see [`SceneBuffers::contents`].
#[derive(Clone, Debug, PartialEq)]
pub struct SceneContents {
    /// Where a variant of the kernels walks them.
    pub wide: Option<Vec<layout::WideNode>>,
    /// As `wide`.
    pub compact: Option<Vec<layout::CompactNode>>,
    /// As [`crate::bvh::WideBvh::leaf_vertices`] has them, in metres, relative to the anchor.
    pub leaves: Vec<f32>,
    /// In leaf order.
    pub triangles: Vec<layout::Triangle>,
    /// Packed unit normals of all vertices.
    pub normals: Vec<u32>,
    /// Unit tangents with the bitangent's sign, where the scene needs them.
    pub tangents: Option<Vec<[f32; 4]>>,
}

impl SceneBuffers {
    /// Reads them back and waits for it.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn contents(&self) -> Result<SceneContents> {
        fn may<T: bytemuck::Pod>(buffer: &Option<Buffer<T>>) -> Result<Option<Vec<T>>> {
            buffer.as_ref().map(Buffer::to_vec).transpose()
        }
        Ok(SceneContents {
            wide: may(&self.wide)?,
            compact: may(&self.compact)?,
            leaves: self.leaves.to_vec()?,
            triangles: self.triangles.to_vec()?,
            normals: self.normals.to_vec()?,
            tangents: may(&self.tangents)?,
        })
    }
}
