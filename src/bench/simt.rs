//! How many lanes of a warp have something to do, from what their rays visit.
//!
//! Lanes run in step: while one of them visits a node all wait that do not, and then while one of them tests a triangle.
//! What they do in all steps, over what they could have done, is their SIMT efficiency (Aila and Laine 2009, "Understanding
//! the efficiency of ray traversal on GPUs").

/// Lanes of a warp.
pub const WARP: usize = 32;

/// Triangles that the kernels' lanes test at most before those that are at nodes go on: as `kernels/shared/compact.h` says.
pub const BURST: u8 = 2;

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
    /// The steps of one warp, whose lanes each have so many triangles to test after each of their nodes. In turn each lane
    /// that has none left visits its next node, and each that has some tests at most `burst` of them.
    ///
    /// # Panics
    /// If there are more than [`WARP`] lanes, or `burst` is 0.
    pub fn of_warp(lanes: &[&[u8]], burst: u8) -> Steps {
        assert!(lanes.len() <= WARP && burst > 0, "{} lanes, {burst} tests", lanes.len());
        let mut lanes: Vec<(&[u8], u8)> = lanes.iter().map(|&nodes| (nodes, 0)).collect();
        let mut steps = Steps::default();
        while lanes.iter().any(|&(nodes, left)| !nodes.is_empty() || left > 0) {
            let (mut visits, mut most) = (0, 0);
            for (nodes, left) in &mut lanes {
                if *left == 0
                    && let Some((&tests, rest)) = nodes.split_first()
                {
                    (*nodes, *left) = (rest, tests);
                    visits += 1;
                }
                let tests = burst.min(*left);
                *left -= tests;
                most = most.max(u64::from(tests));
                steps.tests += u64::from(tests);
            }
            steps.nodes += visits;
            steps.node_slots += if visits > 0 { WARP as u64 } else { 0 };
            steps.test_slots += most * WARP as u64;
        }
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
        let both = |nodes: u64, tests: u64| nodes * TESTS_OF_A_NODE + tests;
        let all = share(both(self.nodes, self.tests), both(self.node_slots, self.test_slots));
        [share(self.nodes, self.node_slots), share(self.tests, self.test_slots), all]
    }
}

/// Warps whose lanes have a ray each: those of bundles of [`WARP`].
pub fn ray_per_lane(rays: &[Vec<u8>], burst: u8) -> Steps {
    let warp = |rays: &[Vec<u8>]| Steps::of_warp(&rays.iter().map(Vec::as_slice).collect::<Vec<_>>(), burst);
    rays.chunks(WARP).map(warp).fold(Steps::default(), Steps::and)
}

/// Warps whose lanes have a bundle of [`WARP`] rays each, one after the other, and wait for each other after each of them.
pub fn bundle_per_lane(rays: &[Vec<u8>], burst: u8) -> Steps {
    let bundles: Vec<&[Vec<u8>]> = rays.chunks(WARP).collect();
    let turn = |warp: &[&[Vec<u8>]], ray: usize| {
        let lanes = warp.iter().filter_map(|bundle| bundle.get(ray)).map(Vec::as_slice);
        Steps::of_warp(&lanes.collect::<Vec<_>>(), burst)
    };
    let warps = bundles.chunks(WARP).flat_map(|warp| (0..WARP).map(move |ray| turn(warp, ray)));
    warps.fold(Steps::default(), Steps::and)
}

/// The same where a lane's next ray begins as soon as the one before is done, as `traverse_stream` of
/// `kernels/shared/streams.h` has it.
pub fn refilled_lanes(rays: &[Vec<u8>], burst: u8) -> Steps {
    let lanes: Vec<Vec<u8>> = rays.chunks(WARP).map(|bundle| bundle.concat()).collect();
    ray_per_lane(&lanes, burst)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_test_as_many() {
        let kernels = include_str!("../../kernels/shared/compact.h");
        assert!(kernels.contains(&format!("#define BURST {BURST}u\n")));
    }

    #[test]
    fn lanes_wait_for_the_longest() {
        let lanes: [&[u8]; 3] = [&[0, 3], &[1], &[2, 1, 0]];
        let steps = Steps::of_warp(&lanes, u8::MAX);
        assert_eq!(steps, Steps { nodes: 6, node_slots: 3 * 32, tests: 7, test_slots: 5 * 32 });
        let [nodes, tests, all] = steps.and(steps).efficiency();
        assert!((nodes - 6.0 / 96.0).abs() < 1e-12 && (tests - 7.0 / 160.0).abs() < 1e-12);
        assert!((all - 25.0 / (14.0 * 32.0)).abs() < 1e-12);
        assert_eq!(Steps::default().efficiency(), [0.0; 3]);
    }

    #[test]
    fn lanes_that_test_one_at_a_time_do_not_wait_at_nodes() {
        // One lane tests four triangles while the other visits as many nodes.
        let steps = Steps::of_warp(&[&[4], &[0, 0, 0, 0]], 1);
        assert_eq!(steps, Steps { nodes: 5, node_slots: 4 * 32, tests: 4, test_slots: 4 * 32 });
        let two = Steps::of_warp(&[&[3, 1], &[0, 2]], 2);
        assert_eq!(two, Steps { nodes: 4, node_slots: 3 * 32, tests: 6, test_slots: 5 * 32 });
    }

    #[test]
    fn rays_that_follow_at_once_fill_the_gaps() {
        // Two bundles: the first one's rays are long where the second one's are short.
        let long = |ray: usize| vec![0u8; if ray.is_multiple_of(2) { 5 } else { 1 }];
        let rays: Vec<Vec<u8>> = (0..64).map(|ray| long(ray + ray / 32)).collect();
        let steps = |node_slots| Steps { nodes: 32 * 6, node_slots, ..Steps::default() };
        assert_eq!(bundle_per_lane(&rays, 1), steps(32 * 5 * 32));
        assert_eq!(refilled_lanes(&rays, 1), steps(16 * 6 * 32));
        assert_eq!(ray_per_lane(&rays, 1), steps(2 * 5 * 32));
    }
}
