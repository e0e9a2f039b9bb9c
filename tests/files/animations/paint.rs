//! Materials that change (KHR_animation_pointer).

use foveate::scene::animation::Choice;
use foveate::scene::{LoadOptions, Material, Scene};
use serde_json::json;

use super::load_at;
use crate::common::painted::{painted, point};

/// The file as it would be without animations at a time: each value by hand.
fn by_hand(time: f64) -> Vec<Material> {
    let share = time / 2.0;
    let between = |a: f64, b: f64| a + (b - a) * share;
    let mut file = painted();
    file.json["animations"] = json!([]);
    let materials = &mut file.json["materials"];
    let uv = &mut materials[0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"];
    uv["KHR_texture_transform"]["offset"] = json!([share, 0.0]);
    uv["KHR_texture_transform"]["rotation"] = json!(share);
    materials[1]["emissiveFactor"] = json!([share, 0.5 * share, 0.25 * share]);
    materials[1]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] =
        json!(between(5.0, 25.0));
    materials[2]["pbrMetallicRoughness"]["baseColorFactor"] =
        json!([between(0.2, 1.0), between(0.3, 0.9), between(0.4, 0.0), between(1.0, 0.5)]);
    file.load().unwrap().materials
}

/// The farthest that what changes of a material is from what it should be.
fn off(is: &Material, should: &Material) -> f32 {
    let uv = |m: &Material| {
        let texture = m.base_color_texture.map(|texture| (texture.matrix, texture.offset));
        let (matrix, offset) = texture.unwrap_or_default();
        matrix.to_cols_array().into_iter().chain(offset.to_array()).collect::<Vec<f32>>()
    };
    let uvs = uv(is).into_iter().zip(uv(should)).map(|(a, b)| (a - b).abs());
    let colors = (is.base_color - should.base_color).abs().max_element();
    uvs.fold(colors.max((is.emissive - should.emissive).abs().max_element()), f32::max)
}

#[test]
fn materials_are_those_that_a_file_of_that_instant_has() {
    let file = painted();
    for time in [0.1, 0.75, 1.0, 2.0] {
        let (scene, right) = (load_at(&file, "all", time).unwrap(), by_hand(time));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        for (is, should) in scene.materials.iter().zip(&right) {
            assert!(off(is, should) < 1e-5, "{time}: {is:?} is not {should:?}");
            assert_eq!(is.alpha, should.alpha);
        }
    }
    let rest = load_at(&file, "none", 1.0).unwrap();
    assert!(off(&rest.materials[2], &by_hand(0.0)[2]) == 0.0);
}

#[test]
fn materials_that_go_on_are_at_their_most_first_and_then_where_their_time_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = painted().write_glb(folder.path());
    let options = LoadOptions { animation: Choice::All, keeps_motion: true, ..LoadOptions::default() };
    let scene = Scene::load_with(&path, &options).unwrap();
    assert_eq!(scene.materials[1].emissive.to_array(), [25.0, 12.5, 6.25]);
    let motion = scene.motion.clone().unwrap();
    assert_eq!(motion.materials.len(), 3);
    for time in [1.0, 0.1, 2.0, 0.75] {
        let pose = motion.skeleton.pose(time);
        let right = by_hand(time);
        for moving in &motion.materials {
            let mut is = scene.materials[moving.material].clone();
            moving.paint(&pose, &mut is);
            assert!(off(&is, &right[moving.material]) < 1e-5, "{time}: {is:?}");
        }
    }
}

#[test]
fn what_is_wrong_with_pointers_to_materials_is_told() {
    let warning = |pointer: &str, width: usize| {
        let mut file = painted();
        let values = match width {
            1 => file.floats(&[[0.0], [1.0]]),
            2 => file.floats(&[[0.0; 2], [1.0; 2]]),
            _ => file.floats(&[[0.0; 3], [1.0; 3]]),
        };
        point(&mut file, pointer, values);
        load_at(&file, "all", 1.0).unwrap().warnings.concat()
    };
    for (pointer, width, part) in [
        ("/materials/9/emissiveFactor", 3, "material 9, which is not there"),
        ("/materials/x/emissiveFactor", 3, "\"/materials/x/emissiveFactor\", which is not played"),
        ("/materials/0/alphaCutoff", 1, "which is not played"),
        ("/materials/0/emissiveFactor", 1, "keys of an animation"),
        (
            "/materials/1/normalTexture/extensions/KHR_texture_transform/offset",
            2,
            "a texture that material 1 does not have",
        ),
    ] {
        let told = warning(pointer, width);
        assert!(told.contains("animation 0 \"Paint\"") && told.contains(part), "{pointer}: {told}");
    }
    // Out of what glTF allows: within it.
    let mut file = painted();
    let wild = file.floats(&[[-3.0, 7.0, 1e30], [-3.0, 7.0, 1e30]]);
    point(&mut file, "/materials/1/emissiveFactor", wild);
    let emitted = load_at(&file, "all", 1.0).unwrap().materials[1].emissive;
    assert!(emitted.is_finite() && emitted.x == 0.0 && emitted.y > 0.0, "{emitted}");
}
