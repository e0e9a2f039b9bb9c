//! What glTF 2.0 can say about a static scene, one small file for each thing.

mod common;

use std::f32::consts::FRAC_PI_2;

use common::builder::{Builder, FLOAT, I8, I16, U8, U16, glb, split_glb};
use foveate::scene::{AlphaMode, LightKind, Scene};
use glam::{DVec3, Vec2, Vec3, Vec4};
use serde_json::{Value, json};

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
const UVS: [[f32; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

/// World positions of the corners of all triangles.
fn corners(scene: &Scene) -> Vec<[DVec3; 3]> {
    let world = |i: u32| scene.anchor + scene.mesh.positions[i as usize].as_dvec3();
    scene.mesh.triangles.iter().map(|triangle| triangle.map(world)).collect()
}

/// The direction from which a triangle is counter-clockwise.
fn front([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize()
}

fn one_triangle(node: Value) -> Builder {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    builder.place(json!({ "attributes": { "POSITION": positions } }), node);
    builder
}

fn refusal(builder: &Builder) -> String {
    let message = builder.load().unwrap_err().to_string();
    assert!(message.contains("scene.gltf") && !message.contains('\n'), "{message}");
    message
}

/// A triangle with texture coordinates and a material.
fn with_material(material: impl FnOnce(&mut Builder) -> Value) -> Builder {
    let mut builder = Builder::new();
    let material = material(&mut builder);
    let (positions, uvs) = (builder.floats(&TRIANGLE), builder.floats(&UVS));
    builder.push("materials", material);
    builder.place(
        json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs }, "material": 0 }),
        json!({}),
    );
    builder
}

#[test]
fn a_triangle_without_indices_gets_a_flat_normal_and_the_default_material() {
    let scene = one_triangle(json!({})).load().unwrap();
    assert_eq!(scene.mesh.triangles, [[0, 1, 2]]);
    assert_eq!(scene.mesh.normals, [Vec3::Z; 3]);
    assert_eq!(scene.materials, [Default::default()]);
    assert_eq!((scene.anchor, scene.instances), (DVec3::new(0.5, 0.5, 0.0), 1));
    assert!(
        scene.mesh.uvs.iter().all(Vec::is_empty)
            && scene.mesh.tangents.is_empty()
            && scene.mesh.colors.is_empty()
    );
    assert!(scene.warnings.is_empty());
}

#[test]
fn glb_and_data_uri_give_the_same_scene() {
    let builder = one_triangle(json!({ "translation": [1, 2, 3] }));
    let folder = tempfile::tempdir().unwrap();
    let binary = Scene::load(&builder.write_glb(folder.path())).unwrap();
    assert_eq!(corners(&binary), corners(&builder.load().unwrap()));
}

#[test]
fn transforms_compose_in_double_precision() {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    let mesh = builder.push("meshes", json!({ "primitives": [{ "attributes": { "POSITION": positions } }] }));
    builder.push("nodes", json!({ "mesh": mesh, "translation": [0.0, -1.0e7, 0.125] }));
    builder.push("nodes", json!({ "children": [0], "rotation": [0, 0, 2, 2] }));
    let matrix = json!([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, -2.0e7, 0.25, 0, 1]);
    builder.push("nodes", json!({ "children": [1], "matrix": matrix }));
    builder.show(2);
    let scene = builder.load().unwrap();
    // The turn by a quarter takes -y to +x; what is left is small beside 1e7 and must survive.
    let expected = [[0.0, 0.25, 0.25], [0.0, 2.25, 0.25], [-2.0, 0.25, 0.25]].map(DVec3::from_array);
    for (is, should) in corners(&scene)[0].iter().zip(expected) {
        assert!((*is - should).length() < 1e-6, "{is} {should}");
    }
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let scene =
        one_triangle(json!({ "translation": [1.0e9, 0, 0], "scale": [0.001, 0.001, 0.001] })).load().unwrap();
    let [a, b, c] = scene.mesh.triangles[0].map(|i| scene.mesh.positions[i as usize]);
    assert!((b - a - Vec3::X * 0.001).length() < 1e-6 && (c - a - Vec3::Y * 0.001).length() < 1e-6);
    assert_eq!(scene.anchor.x.round(), 1.0e9);
}

#[test]
fn negative_scale_keeps_the_front_in_front() {
    let mut builder = Builder::new();
    let (positions, normals) = (builder.floats(&TRIANGLE), builder.floats(&[[0.0, 0.0, 1.0]; 3]));
    builder.place(
        json!({ "attributes": { "POSITION": positions, "NORMAL": normals } }),
        json!({ "scale": [-1, 1, 1] }),
    );
    let scene = builder.load().unwrap();
    assert!((front(corners(&scene)[0]) - DVec3::Z).length() < 1e-9);
    assert_eq!(scene.mesh.normals, [Vec3::Z; 3]);

    let mirrored_depth = one_triangle(json!({ "scale": [1, 1, -1] })).load().unwrap();
    assert!((front(corners(&mirrored_depth)[0]) - DVec3::NEG_Z).length() < 1e-9);
    assert_eq!(mirrored_depth.mesh.normals, [Vec3::NEG_Z; 3]);
}

#[test]
fn normals_follow_uneven_scale() {
    let mut builder = Builder::new();
    let slope = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, -1.0]];
    let normal = Vec3::new(0.0, 1.0, 1.0).normalize().to_array();
    let (positions, normals) = (builder.floats(&slope), builder.floats(&[normal; 3]));
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    for scale in [[1.0, 3.0, 1.0], [-2.0, 3.0, 0.5], [-1.0, -1.0, -1.0]] {
        builder.place(json!({ "attributes": attributes }), json!({ "scale": scale }));
    }
    let scene = builder.load().unwrap();
    for (triangle, corners) in scene.mesh.triangles.iter().zip(corners(&scene)) {
        let normal = scene.mesh.normals[triangle[0] as usize].as_dvec3();
        assert!((normal - front(corners)).length() < 1e-6, "{normal} {}", front(corners));
    }
}

#[test]
fn singular_transforms_flatten() {
    let mut builder = Builder::new();
    let slope = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 1.0, 1.0]];
    let (positions, normals) = (builder.floats(&slope), builder.floats(&[[0.0, 0.0, 1.0]; 3]));
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    for scale in [[1, 1, 0], [0, 0, 1], [0, 0, 0]] {
        builder.place(json!({ "attributes": attributes }), json!({ "scale": scale }));
    }
    let scene = builder.load().unwrap();
    assert_eq!(corners(&scene).len(), 1);
    assert!(corners(&scene)[0].iter().all(|p| p.z.abs() < 1e-9));
    assert_eq!(scene.mesh.normals[0], Vec3::Z);
    assert!(scene.warnings[0].contains("2 without area"), "{:?}", scene.warnings);
}

#[test]
fn strips_and_fans_keep_their_winding() {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let mut builder = Builder::new();
    let positions = builder.floats(&square);
    let fan = builder.shorts(&[0, 1, 3, 2]);
    let stitched = builder.shorts(&[0, 1, 2, 3, 3, 0, 0, 1, 2, 3]);
    builder.place(json!({ "attributes": { "POSITION": positions }, "mode": 5 }), json!({}));
    builder.place(json!({ "attributes": { "POSITION": positions }, "mode": 6, "indices": fan }), json!({}));
    builder
        .place(json!({ "attributes": { "POSITION": positions }, "mode": 5, "indices": stitched }), json!({}));
    let scene = builder.load().unwrap();
    assert_eq!(scene.mesh.triangles.len(), 2 + 2 + 4);
    assert!(corners(&scene).iter().all(|&triangle| (front(triangle) - DVec3::Z).length() < 1e-9));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn points_and_lines_are_left_out_with_one_warning() {
    let mut builder = one_triangle(json!({}));
    for mode in 0..4 {
        builder.place(json!({ "attributes": { "POSITION": 0 }, "mode": mode }), json!({}));
    }
    let scene = builder.load().unwrap();
    assert_eq!((scene.mesh.triangles.len(), scene.warnings.len()), (1, 1));
    assert!(scene.warnings[0].contains("4 primitives of points or lines"));
    builder.place(json!({ "attributes": { "POSITION": 0 }, "mode": 7 }), json!({}));
    assert!(refusal(&builder).contains("unknown mode"));
}

#[test]
fn indices_that_point_nowhere_are_refused() {
    for (indices, reason) in [([0, 1, 3], "vertex 3"), ([0, 1, u16::MAX], "primitive restart")] {
        let mut builder = Builder::new();
        let (positions, indices) = (builder.floats(&TRIANGLE), builder.shorts(&indices));
        builder.place(json!({ "attributes": { "POSITION": positions }, "indices": indices }), json!({}));
        assert!(refusal(&builder).contains(reason));
    }
}

#[test]
fn shared_vertices_are_stored_once_and_unused_ones_not_at_all() {
    let mut builder = Builder::new();
    let mut vertices = vec![[9.0, 9.0, 9.0]; 100];
    vertices.extend([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let (positions, normals) = (builder.floats(&vertices), builder.floats(&[[0.0, 0.0, 1.0]; 104]));
    let indices = builder.shorts(&[100, 101, 102, 102, 101, 103]);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    builder.place(json!({ "attributes": attributes, "indices": indices }), json!({}));
    let scene = builder.load().unwrap();
    assert_eq!(scene.mesh.positions.len(), 4);
    assert_eq!(scene.mesh.bounds().unwrap().1, Vec3::new(0.5, 0.5, 0.0));
}

#[test]
fn sparse_accessors_replace_and_may_start_from_zeros() {
    let mut builder = one_triangle(json!({}));
    let indices = builder.view(&[1, 2]);
    let values: Vec<u8> =
        [[2.0_f32, 0.0, 0.0], [0.0, 2.0, 0.0]].iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let values = builder.view(&values);
    let sparse = json!({
        "count": 2,
        "indices": { "bufferView": indices, "componentType": U8 },
        "values": { "bufferView": values },
    });
    let expected = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0];
    builder.json["accessors"][0]["sparse"] = sparse;
    assert_eq!(corners(&builder.load().unwrap())[0], expected);
    builder.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(corners(&builder.load().unwrap())[0], expected);
    builder.json["accessors"][0]["sparse"]["count"] = json!(3);
    assert!(refusal(&builder).contains("accessor 0"));
    builder.json["accessors"][0]["sparse"] = Value::Null;
    builder.json["accessors"][0]["count"] = json!(1_u64 << 60);
    refusal(&builder);
}

#[test]
fn quantized_attributes_are_read_normalised_or_not() {
    let mut builder = Builder::new();
    let shorts: Vec<u8> = [[0_i16, 0, 0, 0], [32767, 0, 0, 0], [0, -32768, 0, 0]]
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let view = builder.view(&shorts);
    builder.json["bufferViews"][view]["byteStride"] = json!(8);
    let accessor = |normalized| json!({ "bufferView": view, "componentType": I16, "type": "VEC3", "count": 3, "normalized": normalized });
    let (raw, scaled) =
        (builder.push("accessors", accessor(false)), builder.push("accessors", accessor(true)));
    let normals = builder.accessor(&[0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0], I8, "VEC3", 3);
    builder.json["bufferViews"][1]["byteStride"] = json!(4);
    builder.json["accessors"][normals]["normalized"] = json!(true);
    builder.place(json!({ "attributes": { "POSITION": raw } }), json!({ "scale": [0.5, 0.5, 0.5] }));
    builder.place(json!({ "attributes": { "POSITION": scaled, "NORMAL": normals } }), json!({}));
    builder.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let scene = builder.load().unwrap();
    let [raw, scaled] = corners(&scene)[..] else { panic!() };
    assert!((raw[1].x - 16383.5).abs() < 1e-2 && (raw[2].y + 16384.0).abs() < 1e-2, "{raw:?}");
    assert!((scaled[1].x - 1.0).abs() < 1e-2 && (scaled[2].y + 1.0).abs() < 1e-2, "{scaled:?}");
    assert_eq!(scene.mesh.normals[3..], [Vec3::Z; 3]);
}

#[test]
fn attributes_must_match_their_primitive() {
    let mut builder = one_triangle(json!({}));
    let short = builder.floats(&[[0.0, 0.0, 1.0]; 2]);
    builder.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(short);
    assert!(refusal(&builder).contains("NORMAL"));
    let wrong = builder.floats(&[[0.0, 1.0]; 3]);
    builder.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(wrong);
    assert!(refusal(&builder).contains("NORMAL"));
    builder.json["accessors"][0]["count"] = json!(4);
    assert!(refusal(&builder).contains("more than bufferView 0 holds"));
    builder.json["accessors"][0]["byteOffset"] = json!(u64::MAX / 2);
    refusal(&builder);
}

#[test]
fn a_material_uses_up_to_two_sets_of_coordinates() {
    let mut builder = Builder::new();
    let colors = [[10, 20, 30, 255], [200, 100, 50, 255]];
    let texture = builder.texture(&colors);
    builder.push(
        "materials",
        json!({
            "name": "three sets",
            "emissiveFactor": [1, 1, 1],
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": texture, "texCoord": 3 },
                "metallicRoughnessTexture": { "index": texture, "texCoord": 1 },
            },
            "emissiveTexture": { "index": texture, "texCoord": 0 },
        }),
    );
    let positions = builder.floats(&TRIANGLE);
    let sets = [0.0_f32, 1.0, 3.0].map(|n| builder.floats(&UVS.map(|uv| uv.map(|v| v + n))));
    let attributes =
        json!({ "POSITION": positions, "TEXCOORD_0": sets[0], "TEXCOORD_1": sets[1], "TEXCOORD_3": sets[2] });
    builder.place(json!({ "attributes": attributes, "material": 0 }), json!({}));
    let scene = builder.load().unwrap();
    assert_eq!(scene.mesh.uvs[0], UVS.map(|uv| Vec2::from(uv) + 3.0));
    assert_eq!(scene.mesh.uvs[1], UVS.map(|uv| Vec2::from(uv) + 1.0));
    let material = &scene.materials[0];
    assert_eq!(material.base_color_texture.unwrap().uv_slot, 0);
    assert_eq!(material.metallic_roughness_texture.unwrap().uv_slot, 1);
    assert_eq!(material.emissive_texture.unwrap().uv_slot, 0);
    assert_eq!(scene.warnings.len(), 1);
    assert!(scene.warnings[0].contains("three sets"));
    // Colour and emission read the image as sRGB, roughness as linear.
    let [base, rough] =
        [material.base_color_texture, material.metallic_roughness_texture].map(|t| t.unwrap().texture);
    assert_eq!(material.emissive_texture.unwrap().texture, base);
    assert_eq!(scene.textures.iter().map(|t| t.srgb).collect::<Vec<_>>(), [true, false]);
    assert_ne!(base, rough);
    assert_eq!(scene.textures[0].texels[..2], colors);
}

#[test]
fn samplers_are_read() {
    let mut builder = with_material(|builder| {
        let texture = builder.texture(&[[1, 2, 3, 255], [4, 5, 6, 255]]);
        builder.push("samplers", json!({ "magFilter": 9728, "wrapS": 33071, "wrapT": 33648 }));
        builder.json["textures"][texture]["sampler"] = json!(0);
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } })
    });
    let scene = builder.load().unwrap();
    use foveate::scene::texture::Wrap::{ClampToEdge, MirroredRepeat};
    assert_eq!(scene.textures[0].wrap, [ClampToEdge, MirroredRepeat]);
    assert!(scene.textures[0].nearest);
    builder.json["samplers"][0]["wrapS"] = json!(1);
    assert!(refusal(&builder).contains("sampler 0"));
}

#[test]
fn texture_transforms_apply_to_every_kind_of_texture() {
    let transform =
        json!({ "KHR_texture_transform": { "offset": [0, 1], "rotation": FRAC_PI_2, "scale": [0.5, 0.5] } });
    let scene = with_material(|builder| {
        let index = builder.texture(&[[1, 2, 3, 255], [250, 250, 200, 255]]);
        let info = json!({ "index": index, "extensions": transform });
        json!({
            "pbrMetallicRoughness": { "baseColorTexture": info, "metallicRoughnessTexture": info },
            "normalTexture": info, "occlusionTexture": info, "emissiveTexture": info, "emissiveFactor": [1, 1, 1],
        })
    });
    let scene = scene.load().unwrap();
    let m = &scene.materials[0];
    let all = [
        m.base_color_texture,
        m.metallic_roughness_texture,
        m.normal_texture,
        m.occlusion_texture,
        m.emissive_texture,
    ];
    for texture in all.map(Option::unwrap) {
        // The extension's own example: the lower left quadrant of the image.
        let at = |u, v| texture.matrix * Vec2::new(u, v) + texture.offset;
        assert!((at(0.0, 0.0) - Vec2::new(0.0, 1.0)).length() < 1e-6);
        assert!((at(1.0, 0.0) - Vec2::new(0.0, 0.5)).length() < 1e-6);
        assert!((at(0.0, 1.0) - Vec2::new(0.5, 1.0)).length() < 1e-6);
    }
}

#[test]
fn vertex_colours_are_kept_unless_white() {
    let mut builder = one_triangle(json!({}));
    let white = builder.floats(&[[1.0, 1.0, 1.0]; 3]);
    builder.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(white);
    assert!(builder.load().unwrap().mesh.colors.is_empty());

    let colors = builder.accessor(&[255, 0, 51, 255, 0, 0, 0, 0, 255, 255, 255, 255], U8, "VEC4", 3);
    builder.json["accessors"][colors]["normalized"] = json!(true);
    builder.place(json!({ "attributes": { "POSITION": 0, "COLOR_0": colors } }), json!({}));
    let scene = builder.load().unwrap();
    assert_eq!(scene.mesh.colors[..3], [Vec4::ONE; 3]);
    assert_eq!(scene.mesh.colors[3..], [Vec4::new(1.0, 0.0, 0.2, 1.0), Vec4::ZERO, Vec4::ONE]);
}

#[test]
fn extensions_of_materials_are_read_with_their_textures() {
    let load = |material: &dyn Fn(&mut Builder) -> serde_json::Value| with_material(material).load().unwrap();
    let scene = load(&|builder| {
        let texture = builder.texture(&[[10, 20, 30, 40], [200, 100, 50, 255]]);
        json!({ "extensions": {
            "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatTexture": { "index": texture } },
            "KHR_materials_sheen": { "sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.4 },
            "KHR_materials_anisotropy": { "anisotropyStrength": 0.6, "anisotropyRotation": 1.5 }
        } })
    });
    let layers = scene.materials[0].layers.as_ref().unwrap();
    assert_eq!((layers.coat, layers.sheen_roughness, layers.anisotropy), (0.5, 0.4, 0.6));
    assert_eq!(layers.coat_texture.map(|texture| texture.texture), Some(0));
    assert!(!scene.textures[0].srgb && scene.warnings.is_empty());

    let scene = load(&|builder| {
        let texture = builder.texture(&[[10, 20, 30, 40], [200, 100, 50, 255]]);
        json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.5, 0.25, 0.125, 1.0], "specularFactor": [1.0, 0.5, 0.25], "glossinessFactor": 0.75,
            "specularGlossinessTexture": { "index": texture }
        } } })
    });
    let (material, layers) = (&scene.materials[0], scene.materials[0].layers.as_ref().unwrap());
    assert_eq!(
        (material.base_color, material.metallic, material.roughness),
        (Vec4::new(0.5, 0.25, 0.125, 1.0), 0.0, 0.25)
    );
    assert!(layers.glossy && scene.textures[0].srgb);
    assert_eq!(layers.specular_color_texture, material.metallic_roughness_texture);

    let scene = load(&|_| {
        json!({ "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1.0 },
            "KHR_materials_volume": { "thicknessFactor": 0.1, "attenuationDistance": 1.0, "attenuationColor": [1, 0.5, 0.5] }
        } })
    });
    let material = &scene.materials[0];
    assert!(material.double_sided && material.glass.is_some_and(|glass| glass.solid && glass.ior == 1.5));

    // A texture that is not there is refused, wherever it is asked for.
    let builder = with_material(
        |_| json!({ "extensions": { "KHR_materials_sheen": { "sheenColorTexture": { "index": 7 } } } }),
    );
    let refused = builder.load().unwrap_err().to_string();
    assert!(refused.contains("texture 7"), "{refused}");
}

#[test]
fn vertex_colours_keep_their_steps_and_what_is_above_one() {
    let mut builder = one_triangle(json!({}));
    let codes: Vec<u8> =
        [1u16, 2, 3, 40_000, 65_535, 0, 9, 8, 7].iter().flat_map(|c| c.to_le_bytes()).collect();
    let colors = builder.accessor(&codes, 5123, "VEC3", 3);
    builder.json["accessors"][colors]["normalized"] = json!(true);
    builder.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    let bright = builder.floats(&[[0.5, 3.0, 1e9], [0.0, -1.0, f32::NAN], [1.0, 1.0, 1.0]]);
    builder.place(json!({ "attributes": { "POSITION": 0, "COLOR_0": bright } }), json!({}));
    let found = builder.load().unwrap().mesh.colors;
    assert_eq!(found[0], Vec4::new(1.0 / 65535.0, 2.0 / 65535.0, 3.0 / 65535.0, 1.0));
    assert_eq!(found[3..5], [Vec4::new(0.5, 3.0, 65504.0, 1.0), Vec4::new(0.0, 0.0, 1.0, 1.0)]);
}

#[test]
fn alpha_that_never_hides_anything_is_opaque() {
    let load = |mode: &str, factor: f32, texel: u8, vertex: f32| {
        let mut builder = with_material(|builder| {
            let index = builder.texture(&[[1, 2, 3, 255], [4, 5, 6, texel]]);
            let pbr = json!({ "baseColorFactor": [1, 1, 1, factor], "baseColorTexture": { "index": index } });
            json!({ "alphaMode": mode, "pbrMetallicRoughness": pbr })
        });
        let colors = builder.floats(&[[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, vertex], [1.0, 1.0, 1.0, 1.0]]);
        builder.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
        builder.load().unwrap().materials[0].alpha
    };
    assert_eq!(load("BLEND", 1.0, 255, 1.0), AlphaMode::Opaque);
    assert_eq!(load("BLEND", 0.9, 255, 1.0), AlphaMode::Blend);
    assert_eq!(load("BLEND", 1.0, 254, 1.0), AlphaMode::Blend);
    assert_eq!(load("BLEND", 1.0, 255, 0.99), AlphaMode::Blend);
    assert_eq!(load("MASK", 1.0, 128, 1.0), AlphaMode::Opaque);
    assert_eq!(load("MASK", 1.0, 127, 1.0), AlphaMode::Mask(0.5));
    assert_eq!(load("MASK", 0.7, 200, 0.7), AlphaMode::Mask(0.5));
    assert_eq!(load("OPAQUE", 0.1, 1, 0.1), AlphaMode::Opaque);
}

#[test]
fn constant_and_ineffective_textures_are_folded_into_factors() {
    let scene = with_material(|builder| {
        let [base, rough, flat, white, red] =
            [[188, 255, 0, 255], [9, 51, 102, 255], [128, 127, 255, 255], [255; 4], [255, 0, 0, 255]]
                .map(|texel| builder.texture(&[texel, texel]));
        json!({
            "pbrMetallicRoughness": {
                "baseColorTexture": { "index": base },
                "metallicRoughnessTexture": { "index": rough },
                "metallicFactor": 0.5,
            },
            "normalTexture": { "index": flat },
            "occlusionTexture": { "index": white },
            "emissiveTexture": { "index": red },
            "emissiveFactor": [0.5, 1, 1],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4 } },
        })
    });
    let scene = scene.load().unwrap();
    let material = &scene.materials[0];
    assert!((material.base_color - Vec4::new(0.5, 1.0, 0.0, 1.0)).length() < 5e-3, "{}", material.base_color);
    assert!((material.roughness - 0.2).abs() < 1e-6 && (material.metallic - 0.2).abs() < 1e-6);
    assert_eq!(material.emissive, Vec3::X * 2.0);
    assert!(material.normal_texture.is_none() && material.occlusion_texture.is_none());
    assert!(scene.textures.is_empty() && scene.mesh.uvs[0].is_empty() && scene.mesh.tangents.is_empty());
}

#[test]
fn unlit_materials_keep_their_colour_alone() {
    let scene = with_material(|builder| {
        let index = builder.texture(&[[1, 2, 3, 255], [9, 9, 9, 255]]);
        let info = json!({ "index": index });
        json!({
            "pbrMetallicRoughness": { "baseColorTexture": info, "metallicRoughnessTexture": info },
            "normalTexture": info, "emissiveTexture": info, "emissiveFactor": [1, 1, 1],
            "extensions": { "KHR_materials_unlit": {} },
        })
    });
    let scene = scene.load().unwrap();
    let material = &scene.materials[0];
    assert!(material.unlit && material.base_color_texture.is_some() && material.normal_texture.is_none());
    assert_eq!((material.emissive, scene.textures.len()), (Vec3::ZERO, 1));
}

#[test]
fn unused_textures_are_not_even_opened() {
    let mut builder = with_material(|_| json!({}));
    builder.push("images", json!({ "uri": "nowhere.png" }));
    builder.push("textures", json!({ "source": 0 }));
    builder.push("materials", json!({ "normalTexture": { "index": 0 } }));
    assert!(builder.load().unwrap().textures.is_empty());
    builder.json["materials"][0] = json!({ "normalTexture": { "index": 0 } });
    assert!(builder.load().unwrap().warnings[0].contains("nowhere.png"));
}

#[test]
fn tangents_are_made_where_a_normal_map_needs_them() {
    let mut builder = with_material(|builder| {
        let index = builder.texture(&[[128, 128, 255, 255], [200, 128, 200, 255]]);
        json!({ "normalTexture": { "index": index, "scale": 0.5 } })
    });
    let scene = builder.load().unwrap();
    assert_eq!(scene.materials[0].normal_scale, 0.5);
    // u grows along x, v (downwards in the picture) along y: the bitangent, towards the picture's top, is -y.
    assert_eq!(scene.mesh.tangents, [Vec4::new(1.0, 0.0, 0.0, -1.0); 3]);
    builder.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let mirrored = builder.load().unwrap();
    assert_eq!(mirrored.mesh.tangents, [Vec4::new(-1.0, 0.0, 0.0, 1.0); 3]);
}

#[test]
fn made_tangents_agree_with_those_of_an_exporter() {
    let Some(path) = common::data("scenes/khronos/NormalTangentMirrorTest/NormalTangentMirrorTest.glb")
    else {
        return;
    };
    let given = Scene::load(&path).unwrap();
    let (mut json, bin) = split_glb(&std::fs::read(&path).unwrap());
    json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TANGENT").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let stripped = folder.path().join("stripped.glb");
    std::fs::write(&stripped, glb(&json, &bin)).unwrap();
    let made = Scene::load(&stripped).unwrap();
    assert_eq!(made.mesh.triangles.len(), given.mesh.triangles.len());
    let corners = given.mesh.triangles.iter().flatten().zip(made.mesh.triangles.iter().flatten());
    let pairs = corners.map(|(&g, &m)| (given.mesh.tangents[g as usize], made.mesh.tangents[m as usize]));
    let agreeing = pairs.clone().filter(|(g, m)| g.w == m.w && g.truncate().dot(m.truncate()) > 0.98).count();
    assert!(agreeing * 100 >= pairs.count() * 98, "{agreeing} of {}", 3 * given.mesh.triangles.len());
}

#[test]
fn morph_targets_are_applied_at_their_default_weights() {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    let deltas = [[0.0, 0.0, 2.0], [0.0, 4.0, 0.0]].map(|delta| builder.floats(&[delta; 3]));
    let primitive = json!({
        "attributes": { "POSITION": positions },
        "targets": [{ "POSITION": deltas[0] }, { "POSITION": deltas[1] }],
    });
    builder.place(primitive, json!({}));
    builder.json["meshes"][0]["weights"] = json!([0.5, 0.25]);
    builder.push("nodes", json!({ "mesh": 0, "weights": [1, 0] }));
    builder.show(1);
    let scene = builder.load().unwrap();
    let first: Vec<DVec3> = corners(&scene).iter().map(|triangle| triangle[0]).collect();
    assert_eq!(first, [DVec3::new(0.0, 1.0, 1.0), DVec3::new(0.0, 0.0, 2.0)]);
}

#[test]
fn skins_are_bound_to_their_joints_at_rest() {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    let joints = builder.accessor(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], U8, "VEC4", 3);
    let weights = builder.floats(&[[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]]);
    let mut inverse = [[0.0_f32; 16]; 2];
    for matrix in &mut inverse {
        (0..4).for_each(|i| matrix[5 * i] = 1.0);
    }
    inverse[1][14] = -1.0;
    let inverse = builder.floats(&inverse);
    let attributes = json!({ "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights });
    // The skinned node's own transform must not matter; the joints' and their parents' must.
    builder.place(json!({ "attributes": attributes }), json!({ "skin": 0, "translation": [100, 0, 0] }));
    builder.push("nodes", json!({ "translation": [0, 0, 10], "children": [2] }));
    builder.push("nodes", json!({ "scale": [3, 3, 3] }));
    builder.show(1);
    builder.push("skins", json!({ "joints": [1, 2], "inverseBindMatrices": inverse }));
    let scene = builder.load().unwrap();
    let expected = [[0.0, 0.0, 10.0], [3.0, 0.0, 7.0], [0.0, 2.0, 8.5]].map(DVec3::from_array);
    for (is, should) in corners(&scene)[0].iter().zip(expected) {
        assert!((*is - should).length() < 1e-6, "{is} {should}");
    }
    builder.json["skins"][0]["joints"] = json!([1]);
    assert!(refusal(&builder).contains("joint 1"));
}

#[test]
fn cameras_and_lights_are_placed_in_the_world() {
    let mut builder = one_triangle(json!({}));
    builder.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 }, "name": "eye" }),
    );
    builder.push(
        "cameras",
        json!({ "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "znear": 0, "zfar": 1 } }),
    );
    builder.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        { "type": "point", "color": [1, 0.5, 0], "intensity": 10, "range": 7 },
        { "type": "directional" },
        { "type": "spot", "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.4 } },
    ]);
    // -Z turns to +X.
    let turn = [0.0, -std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2];
    for (key, value) in [
        ("camera", json!(0)),
        ("camera", json!(1)),
        ("light", json!(0)),
        ("light", json!(1)),
        ("light", json!(2)),
    ] {
        let mut node = json!({ "translation": [5, 6, 7], "rotation": turn, "scale": [2, 3, -4] });
        match key {
            "light" => node["extensions"]["KHR_lights_punctual"]["light"] = value,
            _ => node["camera"] = value,
        }
        let node = builder.push("nodes", node);
        builder.show(node);
    }
    let scene = builder.load().unwrap();
    let [eye, flat] = &scene.cameras[..] else { panic!() };
    assert_eq!((eye.name.as_str(), eye.fov_y, flat.fov_y), ("eye", Some(1.0), None));
    assert_eq!(eye.world_from_eye.position, DVec3::new(5.0, 6.0, 7.0));
    // The z axis is mirrored, so -Z of the node looks along -X.
    assert!((eye.world_from_eye.transform_point(DVec3::NEG_Z) - DVec3::new(4.0, 6.0, 7.0)).length() < 1e-9);
    assert!((eye.world_from_eye.rotation * DVec3::Y - DVec3::Y).length() < 1e-9);
    let [point, sun, spot] = scene.lights[..] else { panic!() };
    assert_eq!(
        (point.kind, point.intensity, point.range),
        (LightKind::Point, Vec3::new(10.0, 5.0, 0.0), 7.0)
    );
    assert_eq!(point.position, Vec3::new(4.5, 5.5, 7.0));
    assert_eq!((sun.kind, sun.intensity, sun.range), (LightKind::Directional, Vec3::ONE, f32::INFINITY));
    assert!((sun.direction - Vec3::NEG_X).length() < 1e-6);
    assert_eq!(
        spot.kind,
        LightKind::Spot { cos_inner: 0.2_f64.cos() as f32, cos_outer: 0.4_f64.cos() as f32 }
    );
}

#[test]
fn triangles_that_are_not_finite_or_have_no_area_are_counted_and_left_out() {
    let mut builder = Builder::new();
    let mut vertices = TRIANGLE.to_vec();
    vertices.extend([[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [2.0, 0.0, 0.0]]);
    let (positions, normals) = (builder.floats(&vertices), builder.floats(&[[0.0, 0.0, f32::NAN]; 6]));
    let indices = builder.shorts(&[0, 1, 2, 0, 1, 3, 0, 1, 4, 0, 1, 5, 1, 1, 2]);
    builder.place(
        json!({ "attributes": { "POSITION": positions, "NORMAL": normals }, "indices": indices }),
        json!({}),
    );
    let scene = builder.load().unwrap();
    assert_eq!(scene.mesh.triangles.len(), 1);
    assert_eq!(scene.mesh.normals[0], Vec3::Z);
    assert!(scene.mesh.positions.iter().chain(&scene.mesh.normals).all(|v| v.is_finite()));
    assert_eq!(scene.warnings.len(), 1);
    assert!(
        scene.warnings[0].contains("2 without area, 2 with coordinates that are not finite"),
        "{:?}",
        scene.warnings
    );
}

/// What cannot be traced is left out by one rule, counted, told once, and counted in `scene info --json`.
#[test]
fn degenerate_input_is_counted_and_told_once() {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    let broken = builder.floats(&[[0.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [0.0, f32::NEG_INFINITY, 0.0]]);
    let (triangle, none) = (builder.shorts(&[0, 1, 2]), builder.accessor(&[], U16, "SCALAR", 0));
    let primitive = |positions: usize, indices: usize| json!({ "attributes": { "POSITION": positions }, "indices": indices });
    builder.place(primitive(positions, triangle), json!({ "translation": [5, 0, 0] }));
    // Beside it one point in single precision, twice.
    for x in [5.0, 7.0] {
        builder.place(
            primitive(positions, triangle),
            json!({ "scale": [1e-12, 1e-12, 1e-12], "translation": [x, 0, 0] }),
        );
    }
    builder.place(primitive(broken, triangle), json!({}));
    builder.place(primitive(positions, triangle), json!({ "scale": [1, 0, 0] }));
    builder.place(primitive(positions, triangle), json!({ "matrix": vec![0; 16] }));
    builder.place(primitive(positions, none), json!({}));
    let scene = builder.load().unwrap();
    assert_eq!((scene.mesh.triangles.len(), scene.instances), (1, 1));
    let told: Vec<&str> = scene.warnings.iter().map(String::as_str).collect();
    assert_eq!(
        told,
        [
            "primitives without triangles were left out: 1",
            "triangles were left out: 4 without area, 1 with coordinates that are not finite",
        ]
    );
    let info = foveate::scene::info::summarise(&scene, &foveate::scene::Environment::constant(Vec3::ONE));
    let left_out = serde_json::to_value(&info).unwrap()["left_out"].clone();
    assert_eq!(left_out, json!({ "not_finite": 1, "no_area": 4, "empty_primitives": 1 }));
}

/// Alone an instance of scale 1e-12 is the scene, and is kept.
#[test]
fn a_tiny_scene_is_a_scene() {
    let scene =
        one_triangle(json!({ "scale": [1e-12, 1e-12, 1e-12], "translation": [1e7, 0, 0] })).load().unwrap();
    assert_eq!((scene.mesh.triangles.len(), scene.warnings.len()), (1, 0));
    let (low, high) = scene.mesh.bounds().unwrap();
    assert!(((high - low).x - 1e-12).abs() < 1e-15, "{low} {high}");
}

#[test]
fn numbers_beyond_single_precision_do_no_harm() {
    let mut builder = one_triangle(json!({ "scale": [1e300, 1e300, 1e300], "translation": [1e300, 0, 0] }));
    builder.push(
        "materials",
        json!({
            "emissiveFactor": [1, 1, 1],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 1e300 } },
        }),
    );
    builder.place(json!({ "attributes": { "POSITION": 0 }, "material": 0 }), json!({}));
    let scene = builder.load().unwrap();
    assert!(scene.anchor.is_finite() && scene.mesh.positions.iter().all(|p| p.is_finite()));
    assert!(scene.materials.iter().all(|material| material.emissive.is_finite()));
}

#[test]
fn cycles_and_shared_children_are_refused_and_depth_is_not() {
    let mut builder = Builder::new();
    builder.push("nodes", json!({ "children": [1] }));
    builder.push("nodes", json!({ "children": [0] }));
    builder.show(0);
    assert!(refusal(&builder).contains("cycle"));
    builder.json["nodes"] = json!([{ "children": [2] }, { "children": [2] }, {}]);
    assert!(refusal(&builder).contains("two parents"));

    let mut builder = one_triangle(json!({}));
    let depth = 100_000;
    for i in 0..depth {
        builder.push("nodes", json!({ "children": [i], "translation": [0.001, 0, 0] }));
    }
    builder.json["scenes"][0]["nodes"] = json!([depth]);
    assert!((corners(&builder.load().unwrap())[0][0].x - 100.0).abs() < 1e-5);
}

#[test]
fn extensions_are_named() {
    let mut builder = one_triangle(json!({}));
    builder.json["extensionsUsed"] = json!(["EXT_one", "KHR_texture_transform", "EXT_one", "EXT_two"]);
    let warnings = builder.load().unwrap().warnings;
    assert_eq!(warnings.len(), 2);
    assert!(warnings[0].contains("EXT_one") && warnings[1].contains("EXT_two"));
    builder.json["extensionsRequired"] = json!(["EXT_two", "KHR_mesh_quantization"]);
    assert!(refusal(&builder).contains("EXT_two"));
}

#[test]
fn a_file_without_anything_to_see_is_an_empty_scene() {
    let mut builder = Builder::new();
    builder.json.as_object_mut().unwrap().remove("scene");
    let scene = builder.load().unwrap();
    assert!(scene.mesh.triangles.is_empty() && scene.mesh.bounds().is_none() && scene.anchor == DVec3::ZERO);
}

#[test]
fn versions_other_than_2_0_are_refused() {
    for asset in [json!({ "version": "1.0" }), json!({ "version": "2.1", "minVersion": "2.1" })] {
        let mut builder = Builder::new();
        builder.json["asset"] = asset;
        assert!(refusal(&builder).contains("version"));
    }
}

/// Loads a document whose one buffer comes from `uri`, from a folder inside `parent`.
fn load_from(parent: &std::path::Path, uri: &str) -> foveate::Result<Scene> {
    let folder = parent.join("scene");
    std::fs::create_dir_all(&folder).unwrap();
    let mut document = one_triangle(json!({})).document();
    document["buffers"][0]["uri"] = json!(uri);
    let path = folder.join("scene.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    Scene::load(&path)
}

#[cfg(unix)]
#[test]
fn only_the_scenes_own_folder_is_read() {
    let parent = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = TRIANGLE.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::create_dir_all(parent.path().join("scene/below")).unwrap();
    std::fs::write(parent.path().join("secret.bin"), &bytes).unwrap();
    std::fs::write(parent.path().join("scene/below/a b%.bin"), &bytes).unwrap();
    std::os::unix::fs::symlink("../../secret.bin", parent.path().join("scene/below/link.bin")).unwrap();

    for uri in ["below/a b%25.bin", "./below/a%20b%25.bin", "below/../below/a%20b%25.bin"] {
        assert_eq!(load_from(parent.path(), uri).unwrap().mesh.triangles.len(), 1, "{uri}");
    }
    let absolute = parent.path().join("secret.bin");
    let outside = [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "below/../../secret.bin",
        "below/link.bin",
        absolute.to_str().unwrap(),
    ];
    for uri in outside {
        let message = load_from(parent.path(), uri).unwrap_err().to_string();
        assert!(message.contains("outside the scene's folder"), "{uri}: {message}");
    }
    for uri in ["http://example.org/a.bin", "file:///etc/passwd", "below", "none.bin", "", "a\0b"] {
        assert!(load_from(parent.path(), uri).is_err(), "{uri}");
    }
}

#[test]
fn data_uris_may_lack_padding_and_must_be_base64() {
    let parent = tempfile::tempdir().unwrap();
    let document = one_triangle(json!({})).document();
    let uri = document["buffers"][0]["uri"].as_str().unwrap();
    for good in [uri.to_string(), uri.trim_end_matches('=').to_string()] {
        assert!(load_from(parent.path(), &good).is_ok());
    }
    for bad in ["data:;base64,&&&&", "data:", "data:,abc"] {
        assert!(load_from(parent.path(), bad).is_err(), "{bad}");
    }
}

#[test]
fn a_buffer_shorter_than_it_claims_is_refused() {
    let mut document = one_triangle(json!({})).document();
    document["buffers"][0]["byteLength"] = json!(1_u64 << 50);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    assert!(Scene::load(&path).unwrap_err().to_string().contains("buffer 0 should have"));
}

#[test]
fn what_is_no_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    assert!(Scene::load(folder.path()).is_err());
    let message = Scene::load(&folder.path().join("none.glb")).unwrap_err().to_string();
    assert!(message.contains("none.glb") && message.contains("no such file"));
}

#[test]
fn integers_may_be_written_as_floats() {
    let mut builder = one_triangle(json!({}));
    builder.json["accessors"][0]["count"] = json!(3.0);
    assert_eq!(builder.load().unwrap().mesh.triangles.len(), 1);
    for count in [json!(-3), json!(2.5), json!("3"), json!(4294967299.0)] {
        builder.json["accessors"][0]["count"] = count;
        refusal(&builder);
    }
    assert_eq!(builder.json["accessors"][0]["componentType"], FLOAT);
}
