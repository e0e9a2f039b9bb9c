//! The kernels' text, and the options they are built with.

use super::Walk;
use crate::scene::Features;

/// All kernel files, in the order in which they depend on each other. They travel in the program and
/// are one translation unit, since not every driver finds include files.
const FILES: [&str; 22] = [
    include_str!("../../kernels/shared/types.h"),
    include_str!("../../kernels/shared/math.h"),
    include_str!("../../kernels/shared/random.h"),
    include_str!("../../kernels/shared/scene.h"),
    include_str!("../../kernels/shared/texture.h"),
    include_str!("../../kernels/shared/traverse.h"),
    include_str!("../../kernels/shared/compact.h"),
    include_str!("../../kernels/shared/surface.h"),
    include_str!("../../kernels/shared/eight.h"),
    include_str!("../../kernels/shared/bsdf.h"),
    include_str!("../../kernels/shared/environment.h"),
    include_str!("../../kernels/shared/light.h"),
    include_str!("../../kernels/shared/camera.h"),
    include_str!("../../kernels/shared/frustum.h"),
    include_str!("../../kernels/shared/tiles.h"),
    include_str!("../../kernels/trace.cl"),
    include_str!("../../kernels/shared/beam.h"),
    include_str!("../../kernels/visibility.cl"),
    include_str!("../../kernels/sun.cl"),
    include_str!("../../kernels/edges.cl"),
    include_str!("../../kernels/shade.cl"),
    include_str!("../../kernels/gather.cl"),
];

/// The whole text.
pub fn text() -> String {
    FILES.join("\n")
}

/// What rays alone need, for measurements of them.
const PROBE_FILES: [&str; 11] = [
    include_str!("../../kernels/shared/types.h"),
    include_str!("../../kernels/shared/math.h"),
    include_str!("../../kernels/shared/random.h"),
    include_str!("../../kernels/shared/scene.h"),
    include_str!("../../kernels/shared/traverse.h"),
    include_str!("../../kernels/shared/compact.h"),
    include_str!("../../kernels/shared/camera.h"),
    include_str!("../../kernels/shared/frustum.h"),
    include_str!("../../kernels/shared/tiles.h"),
    include_str!("../../kernels/trace.cl"),
    include_str!("../../kernels/bundles.cl"),
];

/// The text of the kernels that measurements use.
pub fn probe_text() -> String {
    PROBE_FILES.join("\n")
}

/// Build options: every feature and the variant, always defined, and the depth of the kernels' stacks.
pub fn options(features: &Features, tree_depth: u32, walk: Walk) -> String {
    let mut options = String::from("-cl-std=CL1.2");
    for (name, on) in features.defines() {
        options += &format!(" -D {name}={}", u32::from(on));
    }
    // Seven siblings wait at every level, and eight are written where some count. Rounded up, so that scenes
    // share built kernels.
    let entries = (tree_depth * 7 + 9).next_multiple_of(64);
    options + &format!(" -D SINGLE_RAYS={} -D STACK_SIZE={entries}", u32::from(walk == Walk::Alone))
}
