//! Real scenes: exact counts, and what they must come to.

mod common;

use foveate::scene::info::summarise;
use foveate::scene::{AlphaMode, Environment, Scene};
use glam::{DVec3, Vec2, Vec3};

fn load(relative: &str) -> Option<Scene> {
    Some(Scene::load(&common::data(relative)?).unwrap())
}

#[test]
fn sponza_is_whole() {
    let Some(scene) = load("scenes/sponza/Sponza.gltf") else { return };
    assert_eq!(
        scene.warnings,
        ["triangles were left out: 1 without area, 0 with coordinates that are not finite"]
    );
    assert_eq!(scene.mesh.triangles.len() + 1, 262_267);
    assert_eq!((scene.instances, scene.materials.len()), (103, 25));
    // Two of its 69 images are of one colour, which the factors take over.
    assert_eq!(scene.textures.len(), 67);
    assert!(scene.textures.iter().all(|texture| texture.texels.len() == 349_525));
    let vertices = scene.mesh.positions.len();
    assert_eq!([scene.mesh.tangents.len(), scene.mesh.uvs[0].len()], [vertices; 2]);
    assert!(scene.mesh.uvs[1].is_empty() && scene.mesh.colors.is_empty());
    assert!(scene.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));

    let mask = scene.materials.iter().filter(|material| material.alpha == AlphaMode::Mask(0.5)).count();
    assert_eq!(mask, 3);
    let environment = Environment { width: 1, height: 1, texels: vec![Vec3::ONE], sun: None };
    let info = summarise(&scene, &environment);
    assert_eq!((info.triangles, info.texture_bytes), (262_266, 67 * 349_525 * 4));
    let bounds = info.bounds.unwrap();
    let size = DVec3::from(bounds.max) - DVec3::from(bounds.min);
    assert!((size - DVec3::new(29.767, 12.448, 18.306)).length() < 2e-3, "{size}");
    let json = serde_json::to_value(&info).unwrap();
    assert_eq!(json["features"]["alpha"], true);
    assert_eq!(json["features"]["vertex_colors"], false);
}

#[test]
fn the_samples_have_their_triangles_instances_materials_and_textures() {
    let expected = [
        ("AlphaBlendModeTest.glb", [61, 9, 6, 4]),
        ("BoxTextured.glb", [12, 1, 1, 1]),
        ("CesiumMilkTruck.glb", [3624, 5, 4, 1]),
        ("MetalRoughSpheresNoTextures.glb", [1_040_213, 123, 99, 0]),
        ("MultiUVTest.glb", [12, 1, 1, 2]),
        ("NormalTangentMirrorTest.glb", [5240, 1, 1, 3]),
        ("OrientationTest.glb", [524, 13, 7, 0]),
        ("SimpleSparseAccessor.gltf", [12, 1, 1, 0]),
        ("TextureTransformTest.gltf", [24, 12, 9, 5]),
        ("TriangleWithoutIndices.gltf", [1, 1, 1, 0]),
        ("UnlitTest.glb", [88, 2, 2, 0]),
        ("VertexColorTest.glb", [36, 2, 2, 2]),
        ("WaterBottle.gltf", [4510, 1, 1, 4]),
    ];
    for (file, counts) in expected {
        let folder = file.split('.').next().unwrap();
        let Some(scene) = load(&format!("scenes/khronos/{folder}/{file}")) else { return };
        let sizes =
            [scene.mesh.triangles.len(), scene.instances, scene.materials.len(), scene.textures.len()];
        assert_eq!(sizes, counts, "{file}");
        let clean = file == "MetalRoughSpheresNoTextures.glb" || scene.warnings.is_empty();
        assert!(clean, "{file}: {:?}", scene.warnings);
    }
}

#[test]
fn samples_say_what_they_are_made_to_show() {
    let Some(uv) = load("scenes/khronos/MultiUVTest/MultiUVTest.glb") else { return };
    assert_eq!((uv.mesh.uvs[0].len(), uv.mesh.uvs[1].len(), uv.cameras.len()), (24, 24, 1));
    assert_eq!(uv.materials[0].emissive_texture.unwrap().uv_slot, 1);

    let unlit = load("scenes/khronos/UnlitTest/UnlitTest.glb").unwrap();
    assert!(unlit.materials.iter().all(|material| material.unlit));

    let colors = load("scenes/khronos/VertexColorTest/VertexColorTest.glb").unwrap();
    assert_eq!(colors.mesh.colors.len(), colors.mesh.positions.len());

    let alpha = load("scenes/khronos/AlphaBlendModeTest/AlphaBlendModeTest.glb").unwrap();
    let modes = |wanted: fn(&AlphaMode) -> bool| alpha.materials.iter().filter(|m| wanted(&m.alpha)).count();
    assert_eq!(modes(|mode| *mode == AlphaMode::Blend), 1);
    assert_eq!(modes(|mode| matches!(mode, AlphaMode::Mask(_))), 3);

    let sparse = load("scenes/khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf").unwrap();
    let tips = [DVec3::new(1.0, 2.0, 0.0), DVec3::new(3.0, 3.0, 0.0), DVec3::new(5.0, 4.0, 0.0)];
    let world: Vec<DVec3> = sparse.mesh.positions.iter().map(|p| sparse.anchor + p.as_dvec3()).collect();
    assert!(tips.iter().all(|tip| world.iter().any(|p| (*p - *tip).length() < 1e-6)), "{world:?}");
}

#[test]
fn rotated_coordinates_bring_the_arrow_to_its_marker() {
    let Some(scene) = load("scenes/khronos/TextureTransformTest/TextureTransformTest.gltf") else { return };
    let material = scene.materials.iter().find(|material| material.name == "Rotation").unwrap();
    let arrow = material.base_color_texture.unwrap();
    // Where the file's nodes put the markers, from the corner of the quad where its coordinates are zero.
    let place = |x: f32, y: f32| arrow.matrix * Vec2::new(x + 0.5, 0.5 - y) + arrow.offset;
    let diagonal = |at: Vec2| (at.x - at.y).abs();
    // The arrow points along the diagonal of its image.
    assert!(diagonal(place(-0.079_048, -0.516_267)) < 1e-4);
    assert!(diagonal(place(0.516_267, 0.079_048)) > 0.5);
}

#[test]
fn quantized_positions_need_no_float() {
    let Some(scene) = load("scenes/unsupported/Duck.gltf") else { return };
    assert_eq!((scene.mesh.triangles.len(), scene.textures.len()), (4212, 1));
    let (low, high) = scene.mesh.bounds().unwrap();
    assert!((high - low).min_element() > 0.5 && (high - low).max_element() < 200.0, "{low} {high}");
}
