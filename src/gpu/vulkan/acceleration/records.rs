//! What acceleration structures are built of, as builds read it.

use std::ops::Range;

use ash::vk;

use super::BottomLevel;

/// Bytes of a triangle's corners.
pub(super) const TRIANGLE_BYTES: u64 = size_of::<[f32; 9]>() as u64;

/// Some triangles of a bottom level.
#[derive(Clone, Copy)]
pub struct Triangles<'a> {
    /// The corners of each: x, y and z of the first, the second, the third.
    pub corners: &'a [[f32; 9]],
    /// Rays end at them; shaders are asked about others (`rayQueryProceed`).
    pub opaque: bool,
}

/// Some triangles of a list whose corners change, for a bottom level of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct DynamicTriangles {
    /// Which of the list.
    pub triangles: Range<u32>,
    /// As [`Triangles::opaque`].
    pub opaque: bool,
}

/// A bottom level that is shown somewhere.
#[derive(Clone)]
pub struct Placement {
    /// What is shown.
    pub shape: BottomLevel,
    /// The rows of the matrix that takes its points to the world's. Where it flattens, nothing is shown.
    pub world_from_shape: [[f32; 4]; 3],
    /// Whether rays that cull back faces pass its triangles from behind. Those are seen from the front whose corners go
    /// counter-clockwise in the world.
    pub culled: bool,
}

impl DynamicTriangles {
    /// How many they are.
    pub(super) fn count(&self) -> u32 {
        self.triangles.len() as u32
    }

    /// Where corners of which the first triangle's are at an address are read.
    pub(super) fn geometry<'a>(
        &self,
        start: vk::DeviceAddress,
    ) -> [vk::AccelerationStructureGeometryKHR<'a>; 1] {
        [triangles(start + u64::from(self.triangles.start) * TRIANGLE_BYTES, self.count(), self.opaque)]
    }
}

/// So many triangles, whose corners are at an address.
pub(super) fn triangles<'a>(
    start: vk::DeviceAddress,
    count: u32,
    opaque: bool,
) -> vk::AccelerationStructureGeometryKHR<'a> {
    let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
        .vertex_format(vk::Format::R32G32B32_SFLOAT)
        .vertex_data(vk::DeviceOrHostAddressConstKHR { device_address: start })
        .vertex_stride(size_of::<[f32; 3]>() as u64)
        .max_vertex(3 * count - 1)
        .index_type(vk::IndexType::NONE_KHR);
    let flags = if opaque { vk::GeometryFlagsKHR::OPAQUE } else { vk::GeometryFlagsKHR::empty() };
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { triangles: data })
        .flags(flags)
}

/// Records of placements at an address.
pub(super) fn instances<'a>(start: vk::DeviceAddress) -> vk::AccelerationStructureGeometryKHR<'a> {
    let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
        .data(vk::DeviceOrHostAddressConstKHR { device_address: start });
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data })
}

/// A VkAccelerationStructureInstanceKHR.
pub(super) type Record = [u32; 16];

/// The record of a placement, which every mask sees; one of nothing where the matrix flattens.
pub(super) fn record_of(placement: &Placement) -> Record {
    let mut record = Record::default();
    let volume = determinant(&placement.world_from_shape);
    if volume == 0.0 || !volume.is_finite() {
        return record;
    }
    for (word, value) in record.iter_mut().zip(placement.world_from_shape.as_flattened()) {
        *word = value.to_bits();
    }
    // Fronts are those whose corners go counter-clockwise along right-handed axes, as specifications have it: clockwise along
    // left-handed ones. That is asked before the matrix, which may mirror, has been there.
    let mut flags = vk::GeometryInstanceFlagsKHR::empty();
    if !placement.culled {
        flags |= vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE;
    } else if volume < 0.0 {
        flags |= vk::GeometryInstanceFlagsKHR::TRIANGLE_FLIP_FACING;
    }
    let below = placement.shape.0.address;
    record[12] = 0xff << 24;
    record[13] = flags.as_raw() << 24;
    record[14..].copy_from_slice(&[below as u32, (below >> 32) as u32]);
    record
}

/// How many times as large a matrix makes volumes; below zero where it mirrors.
fn determinant(rows: &[[f32; 4]; 3]) -> f64 {
    let [a, b, c] = rows.map(|row| row.map(f64::from));
    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_that_mirror_are_told_from_those_that_flatten() {
        let scaled = |x: f32, y: f32, z: f32| {
            determinant(&[[x, 0.0, 0.0, 7.0], [0.0, 0.0, y, 8.0], [0.0, z, 0.0, 9.0]])
        };
        assert_eq!(scaled(2.0, 3.0, -0.5), 3.0);
        assert_eq!(scaled(2.0, 3.0, 0.5), -3.0);
        assert_eq!(scaled(2.0, 0.0, 0.5), 0.0);
        assert_eq!(determinant(&[[1.0, 2.0, 3.0, 0.0], [4.0, 5.0, 6.0, 0.0], [7.0, 8.0, 10.0, 0.0]]), -3.0);
    }
}
