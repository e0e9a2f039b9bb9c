//! How what moves as a whole has moved from a view's last frame to this one.

use bytemuck::{Pod, Zeroable};
use glam::DMat4;

use crate::math::view::View;

/// Where a point of something that moves as a whole was: from relative to this frame's eye to relative to the last one's, in
/// world orientation. The rows of a matrix; all 0 where it is not known.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct PackedMotion {
    rows: [[f32; 4]; 3],
}

impl PackedMotion {
    /// Of something that was and is at such a place (`world_from_part`), where both are known.
    fn new(now: &View, last: &View, was: Option<DMat4>, is: Option<DMat4>) -> PackedMotion {
        let (Some(was), Some(is)) = (was, is) else { return PackedMotion::zeroed() };
        let eye = |view: &View| DMat4::from_translation(view.world_from_eye.position);
        let back = DMat4::from_translation(-last.world_from_eye.position);
        let matrix = back * was * is.inverse() * eye(now);
        let rows = [0, 1, 2].map(|axis| matrix.row(axis).as_vec4());
        let finite = rows.iter().all(|row| row.is_finite());
        PackedMotion { rows: if finite { rows.map(|row| row.to_array()) } else { [[0.0; 4]; 3] } }
    }

    /// Of all that moves, by its number less one.
    pub fn all(now: &View, last: &View, was: &[Option<DMat4>], is: &[Option<DMat4>]) -> Vec<PackedMotion> {
        was.iter().zip(is).map(|(&was, &is)| PackedMotion::new(now, last, was, is)).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    #[test]
    fn points_are_where_the_part_was() {
        let fov = FieldOfView::symmetric(1.0, 1.0);
        let eye = |position| View {
            world_from_eye: Pose::new(DQuat::from_rotation_y(0.4), position),
            fov,
            width: 8,
            height: 8,
            spacing: Default::default(),
        };
        let (last, now) = (eye(DVec3::new(40.0, 1.0, 2.0)), eye(DVec3::new(40.5, 1.2, 1.0)));
        let placed = |angle, at: DVec3| DMat4::from_rotation_translation(DQuat::from_rotation_x(angle), at);
        let (was, is) = (placed(0.3, DVec3::new(41.0, 0.0, 0.0)), placed(1.1, DVec3::new(42.0, 0.5, 0.3)));
        let own = DVec3::new(0.3, -0.2, 0.6);
        let found = &PackedMotion::all(&now, &last, &[None, Some(was)], &[Some(is), Some(is), Some(is)]);
        assert_eq!((found.len(), found[0].rows), (2, [[0.0; 4]; 3]));
        let seen = (is.transform_point3(own) - now.world_from_eye.position).extend(1.0);
        let expected = was.transform_point3(own) - last.world_from_eye.position;
        for (axis, row) in found[1].rows.iter().enumerate() {
            let at = glam::DVec4::from(row.map(f64::from)).dot(seen);
            assert!((at - expected[axis]).abs() < 1e-5, "{axis}: {at} {expected}");
        }
    }
}
