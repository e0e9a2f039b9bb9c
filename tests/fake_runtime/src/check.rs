//! Values that the application hands over.

use openxr_sys as xr;

use crate::refusal::{Refusal, invalid, wrong};
use crate::world::Pose;

/// A time that can be asked about.
pub(crate) fn check_time(time: xr::Time) -> Result<i64, Refusal> {
    let nanos = time.as_nanos();
    if nanos <= 0 {
        return Err(wrong(xr::Result::ERROR_TIME_INVALID, format!("the time {nanos} is none")));
    }
    Ok(nanos)
}

/// A pose that the application gave.
pub(crate) fn check_pose(pose: &xr::Posef) -> Result<Pose, Refusal> {
    let ok = Pose::from_xr(pose);
    ok.ok_or_else(|| wrong(xr::Result::ERROR_POSE_INVALID, "the pose's orientation has no length of 1"))
}

/// A field of view that the application gave.
pub(crate) fn check_fov(fov: &xr::Fovf) -> Result<[f32; 4], Refusal> {
    let angles = [fov.angle_left, fov.angle_right, fov.angle_up, fov.angle_down];
    let ok = angles.iter().all(|a| a.abs() < std::f32::consts::FRAC_PI_2)
        && fov.angle_left < fov.angle_right
        && fov.angle_down < fov.angle_up;
    ok.then_some(angles).ok_or_else(|| invalid(format!("{angles:?} is no field of view")))
}
