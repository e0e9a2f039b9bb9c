use super::*;

const HEADER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/kernels/shared/types.h");
const SHADERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/kernels/shared/types.wgsl");

#[test]
fn the_header_is_what_this_room_says() {
    let written = std::fs::read_to_string(HEADER).unwrap();
    assert!(written == types_header(), "run: cargo test --lib write_types_header -- --ignored");
}

#[test]
fn the_shaders_types_are_what_this_room_says() {
    let written = std::fs::read_to_string(SHADERS).unwrap();
    assert!(written == types_wgsl(), "run: cargo test --lib write_types_header -- --ignored");
}

#[test]
#[ignore = "writes kernels/shared/types.h and kernels/shared/types.wgsl"]
fn write_types_header() {
    std::fs::write(HEADER, types_header()).unwrap();
    std::fs::write(SHADERS, types_wgsl()).unwrap();
}

#[test]
fn emission_survives_packing() {
    for rgb in [[1.0, 0.5, 0.25], [1e-6, 2e-6, 5e-7], [1e9, 1.0, 3e8], [0.0; 3], [65504.0, 1.0, 1.0]] {
        let back = unpack_emission(pack_emission(rgb));
        let largest = rgb.iter().fold(0.0f32, |a, &b| a.max(b));
        for (a, b) in rgb.iter().zip(back) {
            assert!((a - b).abs() <= largest / 250.0, "{rgb:?} {back:?}");
        }
    }
    assert_eq!(unpack_emission(pack_emission([f32::NAN, -1.0, f32::INFINITY])), [0.0; 3]);
}

#[test]
fn normals_survive_packing() {
    for n in [[0.0f32, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, -0.8, 0.0], [-0.48, 0.6, -0.64]] {
        let back = unpack_normal(pack_normal(n));
        let cosine: f32 = n.iter().zip(back).map(|(a, b)| a * b).sum();
        assert!(cosine > 0.999_999, "{n:?} {back:?}");
        let back = unpack_normal24(pack_normal24(n) | SUN_VISIBLE);
        let cosine: f32 = n.iter().zip(back).map(|(a, b)| a * b).sum();
        assert!(cosine > 0.999_99, "{n:?} {back:?}");
    }
}
