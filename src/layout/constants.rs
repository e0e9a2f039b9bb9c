//! Numbers that mean the same to the host and to kernels.

/// Constants that kernels share, by their names there.
pub(super) fn named() -> [(&'static str, u32); 40] {
    [
        ("LEAF", LEAF),
        ("EMPTY", EMPTY),
        ("PORTAL", PORTAL),
        ("TRIANGLE_ALPHA", TRIANGLE_ALPHA),
        ("TRIANGLE_DOUBLE_SIDED", TRIANGLE_DOUBLE_SIDED),
        ("SURFACE_MOTION", SURFACE_MOTION),
        ("SURFACE_MOVES", SURFACE_MOVES),
        ("SURFACE_MOVER", SURFACE_MOVER),
        ("BLOCKER_STEPS", BLOCKER_STEPS),
        ("BLOCKER_METRE", BLOCKER_METRE),
        ("UNTRACED", UNTRACED),
        ("TURN_SAMPLES", TURN_SAMPLES),
        ("SUN_VISIBLE", SUN_VISIBLE),
        ("CACHE_CELLS", CACHE_CELLS),
        ("CACHE_PATH", CACHE_PATH),
        ("GLASS_STEPS", GLASS_STEPS),
        ("PATH_QUEUES", PATH_QUEUES),
        ("PATH_WORDS", PATH_WORDS),
        ("STEP_WORDS", STEP_WORDS),
        ("PASSED_WORDS", PASSED_WORDS),
        ("MEET_BLENDS", MEET_BLENDS),
        ("MATERIAL_LAYERED", MATERIAL_LAYERED),
        ("MATERIAL_TINTED", MATERIAL_TINTED),
        ("MATERIAL_GLOSSINESS", MATERIAL_GLOSSINESS),
        ("MATERIAL_SOLID", MATERIAL_SOLID),
        ("SPECULAR_TEXTURE", 5),
        ("SPECULAR_COLOR_TEXTURE", 6),
        ("COAT_TEXTURE", 7),
        ("COAT_ROUGHNESS_TEXTURE", 8),
        ("COAT_NORMAL_TEXTURE", 9),
        ("SHEEN_COLOR_TEXTURE", 10),
        ("SHEEN_ROUGHNESS_TEXTURE", 11),
        ("ANISOTROPY_TEXTURE", 12),
        ("TRANSMISSION_TEXTURE", 13),
        ("IS_MAPPED", IS_MAPPED),
        ("SAMPLE_REUSES", SAMPLE_REUSES),
        ("LAW_LEVEL", LAW_LEVEL),
        ("LAW_POWER", LAW_POWER),
        ("LAW_LINEAR_MAR", LAW_LINEAR_MAR),
        ("LAW_LOG_POLAR", LAW_LOG_POLAR),
    ]
}

/// In [`super::SampleLaw::form`]: the same density everywhere.
pub const LAW_LEVEL: u32 = 0;
/// A power of the distance from the gaze.
pub const LAW_POWER: u32 = 1;
/// Resolution that falls linearly with the angle from the gaze.
pub const LAW_LINEAR_MAR: u32 = 2;
/// A log-polar map's.
pub const LAW_LOG_POLAR: u32 = 3;
/// In [`super::WideNode::children`]: a child slot without a child.
pub const EMPTY: u32 = u32::MAX;
/// Marks a child that is a leaf: then bits 28..31 hold its number of triangles less one, and the
/// low 28 bits its first triangle in leaf order.
pub const LEAF: u32 = 1 << 31;
/// As a node's first child: the node is the door to an instance, whose number the second one is. Its only box is the
/// instance's. In [`super::CompactNode::exponents`] the same; there `first_node` is the number.
pub const PORTAL: u32 = u32::MAX - 1;
/// A hit needs a look at the material's alpha.
pub const TRIANGLE_ALPHA: u32 = 1 << 22;
/// Seen from behind too.
pub const TRIANGLE_DOUBLE_SIDED: u32 = 1 << 23;
/// In [`super::VisibilityRecord::mapped`]: what is seen is elsewhere in other frames.
pub const SURFACE_MOVES: u32 = 1 << 24;
/// From this bit of [`super::VisibilityRecord::mapped`] on: the number of what moves there as a whole, from 1 on; 0 where it
/// has none. See `src/scene/animation/movers.rs`.
pub const SURFACE_MOVER: u32 = 25;
/// All bits of [`SURFACE_MOVES`] and [`SURFACE_MOVER`].
pub const SURFACE_MOTION: u32 = 0xff << 24;
/// Samples that follow each other in a view's list and are shaded in the same frame, where samples take turns: a warp's lanes.
pub const TURN_SAMPLES: u32 = 32;
/// Numbers of what moves as a whole at most: what records can hold.
pub const MAX_MOVERS: usize = 127;
/// In [`super::HitRecord::triangle`]: nothing was traced here, and nobody may follow it.
pub const UNTRACED: u32 = u32::MAX - 1;
/// In [`super::VisibilityRecord::normal`]: the sun's centre is visible.
pub const SUN_VISIBLE: u32 = 1 << 31;
/// In [`super::SampleRecord::normal`]: codes of a distance for each doubling.
pub const BLOCKER_STEPS: u32 = 6;
/// In [`super::SampleRecord::normal`]: the code of a metre.
pub const BLOCKER_METRE: u32 = 49;
/// Cells of the cache of light.
pub const CACHE_CELLS: u32 = 1 << 18;
/// Vertices of the cache's paths beyond those that the eye sees.
pub const CACHE_PATH: u32 = 3;
/// Interfaces that a path through glass crosses at most.
pub const GLASS_STEPS: u32 = 16;
/// Vertices of paths that kernels on GPUs can queue for.
pub const PATH_QUEUES: u32 = 8;
/// Words of memory of a path there: the planes in `kernels/gpu/paths.cl`.
pub const PATH_WORDS: u32 = 17;
/// The same of a ray of a path's step.
pub const STEP_WORDS: u32 = 12;
/// The same of what a path of the cache's has found at a vertex, in `kernels/gpu/cells.cl`.
pub const PASSED_WORDS: u32 = 16;
/// The seed with which what is seen is every BLEND surface, instead of some by chance.
pub const MEET_BLENDS: u32 = u32::MAX;
/// In [`super::Material::extras`]: more than metallic-roughness.
pub const MATERIAL_LAYERED: u32 = 1;
/// In [`super::Material::extras`]: the specular reflection has a colour, and what passes it has none of its own.
pub const MATERIAL_TINTED: u32 = 2;
/// In [`super::Material::extras`]: the metallic-roughness texture has glossiness in A, and no metalness.
pub const MATERIAL_GLOSSINESS: u32 = 4;
/// In [`super::Material::extras`]: transmissive material has an inside, and refracts.
pub const MATERIAL_SOLID: u32 = 8;
/// In [`super::SampleRecord::toward`]: the surface has a normal map.
pub const IS_MAPPED: u32 = 1 << 30;
/// There: earlier frames have left light for the sample, so that it was sent fewer rays than others; none, where its depth is
/// negative, while it waits for its turn.
pub const SAMPLE_REUSES: u32 = 1 << 31;
/// Materials at most: what [`super::Triangle::packed`] can hold.
pub const MAX_MATERIALS: usize = 1 << 16;
