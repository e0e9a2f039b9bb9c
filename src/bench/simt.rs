//! How many lanes of a warp have something to do, from the steps of their rays.
//!
//! Lanes run in step: while one of them visits a node all wait that do not, and then while one of them tests a triangle.
//! What they do in all steps, over what they could have done, is their SIMT efficiency (Aila and Laine 2009, "Understanding
//! the efficiency of ray traversal on GPUs").

/// Lanes of a warp.
pub const WARP: usize = 32;

/// Lanes that share their rays, as many as work-items in a group.
pub const GROUP: usize = 64;

/// A step of a ray in which a node is visited; one of [`crate::trace::probe::CountingProbe::steps`].
pub const AT_NODE: u8 = 1;
/// A step in which a triangle is tested, after that node where there is one.
pub const AT_TRIANGLE: u8 = 2;

/// A node takes as many instructions as so many triangles: some 400 to 130 on NVIDIA's cards.
pub const TESTS_OF_A_NODE: u64 = 3;

/// Steps of lanes that did something, and those that warps took times their lanes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    /// Lanes' visits of nodes.
    pub nodes: u64,
    /// Those there was time for.
    pub node_slots: u64,
    /// Lanes' tests of triangles.
    pub tests: u64,
    /// Those there was time for.
    pub test_slots: u64,
}

impl Steps {
    /// One step of a warp: what its lanes do that do anything.
    fn of_lanes(lanes: impl Iterator<Item = u8>) -> Steps {
        let mut steps = Steps::default();
        for did in lanes {
            steps.nodes += u64::from(did & AT_NODE != 0);
            steps.tests += u64::from(did & AT_TRIANGLE != 0);
        }
        let slots = |busy: u64| if busy > 0 { WARP as u64 } else { 0 };
        (steps.node_slots, steps.test_slots) = (slots(steps.nodes), slots(steps.tests));
        steps
    }

    /// With those of another warp.
    pub fn and(self, other: Steps) -> Steps {
        Steps {
            nodes: self.nodes + other.nodes,
            node_slots: self.node_slots + other.node_slots,
            tests: self.tests + other.tests,
            test_slots: self.test_slots + other.test_slots,
        }
    }

    /// The part of lanes that are busy at nodes, at triangles, and at both where a node takes as long as
    /// [`TESTS_OF_A_NODE`] triangles.
    pub fn efficiency(&self) -> [f64; 3] {
        let share = |busy: u64, all: u64| if all > 0 { busy as f64 / all as f64 } else { 0.0 };
        [
            share(self.nodes, self.node_slots),
            share(self.tests, self.test_slots),
            share(both(self.nodes, self.tests), self.time()),
        ]
    }

    /// What all this takes a lane, in tests of triangles.
    pub fn time(&self) -> u64 {
        both(self.node_slots, self.test_slots)
    }
}

fn both(nodes: u64, tests: u64) -> u64 {
    nodes * TESTS_OF_A_NODE + tests
}

/// Warps whose lanes have a ray each: those of bundles of [`WARP`].
pub fn ray_per_lane(rays: &[Vec<u8>]) -> Steps {
    let warp = |rays: &[Vec<u8>]| {
        let longest = rays.iter().map(Vec::len).max().unwrap_or(0);
        let step = |step: usize| Steps::of_lanes(rays.iter().filter_map(|ray| ray.get(step).copied()));
        (0..longest).map(step).fold(Steps::default(), Steps::and)
    };
    rays.chunks(WARP).map(warp).fold(Steps::default(), Steps::and)
}

/// Warps whose lanes have a bundle of [`WARP`] rays each, and begin its next ray as soon as the one before is done.
pub fn bundle_per_lane(rays: &[Vec<u8>]) -> Steps {
    let lanes: Vec<Vec<u8>> = rays.chunks(WARP).map(|bundle| bundle.concat()).collect();
    ray_per_lane(&lanes)
}

/// Warps whose lanes take the next ray of as many bundles as there are lanes in their group as soon as the one before is
/// done, as `intersect_light_rays` of `kernels/gpu/shade.cl` has it.
pub fn shared_rays(rays: &[Vec<u8>]) -> Steps {
    let group = |rays: &[Vec<u8>]| {
        let bundles = rays.len().div_ceil(WARP);
        // The first ray of each bundle, then the second one of each.
        let in_turn = (0..WARP).flat_map(|ray| (0..bundles).map(move |bundle| bundle * WARP + ray));
        let mut left = in_turn.filter_map(|ray| rays.get(ray));
        let mut warps = vec![[&[] as &[u8]; WARP]; GROUP / WARP];
        let mut steps = Steps::default();
        loop {
            let before = steps;
            for warp in &mut warps {
                for lane in warp.iter_mut().filter(|lane| lane.is_empty()) {
                    *lane = left.next().map_or(&[], Vec::as_slice);
                }
                let step = |lane: &mut &[u8]| {
                    let (did, rest) = lane.split_first()?;
                    *lane = rest;
                    Some(*did)
                };
                steps = steps.and(Steps::of_lanes(warp.iter_mut().filter_map(step)));
            }
            if steps == before && warps.iter().flatten().all(|lane| lane.is_empty()) {
                return steps;
            }
        }
    };
    rays.chunks(GROUP * WARP).map(group).fold(Steps::default(), Steps::and)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_wait_for_the_longest() {
        let rays = [vec![1, 3, 2], vec![3], vec![1, 1, 0, 1]];
        let steps = ray_per_lane(&rays);
        assert_eq!(steps, Steps { nodes: 6, node_slots: 3 * 32, tests: 3, test_slots: 3 * 32 });
        let [nodes, tests, all] = steps.and(steps).efficiency();
        assert!((nodes - 6.0 / 96.0).abs() < 1e-12 && (tests - 3.0 / 96.0).abs() < 1e-12);
        assert!((all - 21.0 / (12.0 * 32.0)).abs() < 1e-12);
        assert_eq!(steps.time(), 12 * 32);
        assert_eq!(Steps::default().efficiency(), [0.0; 3]);
    }

    #[test]
    fn rays_that_follow_at_once_fill_the_gaps() {
        // Two bundles: the first one's rays are long where the second one's are short.
        let long = |ray: usize| vec![AT_NODE; if ray.is_multiple_of(2) { 5 } else { 1 }];
        let rays: Vec<Vec<u8>> = (0..64).map(|ray| long(ray + ray / 32)).collect();
        let steps = |node_slots| Steps { nodes: 32 * 6, node_slots, ..Steps::default() };
        assert_eq!(bundle_per_lane(&rays), steps(16 * 6 * 32));
        assert_eq!(ray_per_lane(&rays), steps(2 * 5 * 32));
        // A group has a lane for each of the rays of two bundles.
        assert_eq!(shared_rays(&rays), steps(2 * 5 * 32));
    }

    #[test]
    fn lanes_that_share_rays_do_not_wait_for_long_bundles() {
        // One bundle of 64 has rays of 60 visits, the others of 4.
        let rays: Vec<Vec<u8>> =
            (0..GROUP * WARP).map(|ray| vec![AT_NODE; if ray < WARP { 60 } else { 4 }]).collect();
        let [alone, shared] = [bundle_per_lane(&rays), shared_rays(&rays)];
        assert_eq!(alone.nodes, shared.nodes);
        assert_eq!(alone.node_slots, (32 * 60 + 32 * 4) * 32);
        assert!(shared.efficiency()[0] > 0.7, "{shared:?}");
    }
}
