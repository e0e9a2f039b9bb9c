//! The floor of the room, by which a wearer's own height counts.

use openxr as xr;

/// Metres below the session's space, at most and at least, at which a floor is believed.
const BELIEVED: std::ops::Range<f64> = 0.2..2.5;
/// Frames after which it is asked again where it is not known.
const AGAIN: u32 = 90;

/// Finds the floor in a session's space.
pub struct Floor {
    /// A space whose origin is on the floor, where the runtime has one.
    space: Option<xr::Space>,
    known: Option<f64>,
    rests: u32,
}

impl Floor {
    /// Looks for LOCAL_FLOOR, of OpenXR 1.1, and STAGE.
    pub fn new(session: &xr::Session<xr::Vulkan>) -> Self {
        use xr::ReferenceSpaceType as Type;
        let offered = session.enumerate_reference_spaces().unwrap_or_default();
        let best = [Type::LOCAL_FLOOR, Type::STAGE].into_iter().find(|kind| offered.contains(kind));
        let space = best.and_then(|kind| session.create_reference_space(kind, xr::Posef::IDENTITY).ok());
        Floor { space, known: None, rests: 0 }
    }

    /// The floor's height in another space, where that is not what it was.
    pub fn moved(&mut self, space: &xr::Space, time: xr::Time) -> Option<f64> {
        let floor = self.space.as_ref().filter(|_| self.known.is_none() && self.rests == 0);
        self.rests = self.rests.saturating_sub(1);
        let location = floor?.locate(space, time).ok();
        let valid = location.filter(|at| at.location_flags.contains(xr::SpaceLocationFlags::POSITION_VALID));
        let height = valid.map(|at| f64::from(at.pose.position.y)).filter(|y| BELIEVED.contains(&-y));
        if height.is_none() {
            self.rests = AGAIN;
        }
        self.known = height;
        height
    }

    /// The space is about to change, so the floor is asked for again after that.
    pub fn forget(&mut self) {
        (self.known, self.rests) = (None, AGAIN);
    }
}
