// Written from src/layout/: change it there.
struct SampleRecord {
    first: vec3<f32>,
    depth: f32,
    second: vec3<f32>,
    normal: u32,
    toward: vec3<u32>,
    reflected: u32,
}

struct VisibilityRecord {
    normal: u32,
    depth: f32,
    base: u32,
    surface: u32,
    emission: u32,
    mapped: u32,
    reflected: u32,
}

const SURFACE_MOVES = 0x1000000u;
const SURFACE_MOVER = 0x19u;
const BLOCKER_STEPS = 0x6u;
const BLOCKER_METRE = 0x31u;
const SUN_VISIBLE = 0x80000000u;
const IS_MAPPED = 0x40000000u;
const SAMPLE_REUSES = 0x80000000u;
