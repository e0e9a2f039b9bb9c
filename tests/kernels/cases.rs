//! What light does, one kind of it after the other.

use foveate::math::view::View;
use foveate::scene::sky::Sky;
use foveate::scene::{AlphaMode, Environment, Glass, Layers, Light, LightKind, Material, Scene, Sun};
use glam::{DVec3, Vec3, Vec4};

use crate::bench::view;
use crate::radiance::{Case, assert_all_agree};
use crate::scenes::{
    colourful, cuboid, floor, mapped, matt, metal, quad, round_ball, scene_of, sky, texture,
};

/// A floor with a block on it.
fn stage(ground: Material, block: Material) -> Scene {
    let mut scene = scene_of(vec![ground, block]);
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-0.9, 0.0, -0.5), Vec3::new(0.1, 0.8, 0.4), 1);
    scene
}

fn dark() -> Environment {
    Environment::constant(Vec3::ZERO)
}

pub fn floor_under_sky() -> Case {
    let light = Sky { sun_elevation_deg: 40.0, sun_azimuth_deg: 250.0, ..Sky::default() }.bake();
    Case::new("diffuse under sky and sun", stage(matt(0.6), matt(0.3)), light)
}

#[test]
fn materials() {
    assert_all_agree(|| {
        let plastic = |roughness| Material { roughness, ..matt(0.4) };
        let gold = Vec3::new(1.0, 0.7, 0.3);
        let case = |name, material: Material| Case::new(name, stage(material.clone(), material), colourful());
        vec![
            floor_under_sky(),
            case("rough metal", metal(gold, 0.6)),
            case("glossy metal", metal(gold, 0.25)),
            case("smooth metal", metal(gold, 0.05)),
            case("mirror", metal(gold, 0.0)),
            case("rough dielectric", plastic(1.0)),
            case("glossy dielectric", plastic(0.2)),
            case("half metal", Material { metallic: 0.5, roughness: 0.4, ..metal(gold, 0.4) }),
        ]
    });
}

/// A material for each extension, and one for all together.
pub fn layered_materials() -> Vec<(&'static str, Material)> {
    let with = |base: Material, change: &dyn Fn(&mut Layers)| {
        let mut layers = Layers::default();
        change(&mut layers);
        Material { layers: Some(Box::new(layers)), ..base }
    };
    let plastic = |roughness| Material { roughness, ..matt(0.4) };
    let gold = metal(Vec3::new(1.0, 0.7, 0.3), 0.5);
    vec![
        (
            "tinted specular",
            with(plastic(0.4), &|l| (l.dielectric, l.specular) = (Vec3::new(0.5, 0.2, 0.02), 0.7)),
        ),
        ("index of 2.4", with(plastic(0.3), &|l| l.dielectric = Vec3::splat(0.17))),
        ("no specular", with(plastic(0.3), &|l| l.specular = 0.0)),
        (
            "gold by specular-glossiness",
            with(Material { roughness: 0.4, ..matt(0.0) }, &|l| {
                l.dielectric = Vec3::new(1.0, 0.7, 0.3);
            }),
        ),
        ("coated gold", with(gold.clone(), &|l| (l.coat, l.coat_roughness) = (1.0, 0.35))),
        ("half coat on plastic", with(plastic(0.8), &|l| (l.coat, l.coat_roughness) = (0.5, 0.3))),
        (
            "velvet",
            with(plastic(1.0), &|l| {
                (l.sheen_color, l.sheen_roughness) = (Vec3::new(0.9, 0.3, 0.5), 0.5);
            }),
        ),
        ("brushed gold", with(gold, &|l| (l.anisotropy, l.anisotropy_rotation) = (0.8, 0.6))),
        (
            "everything",
            with(Material { metallic: 0.3, ..plastic(0.4) }, &|l| {
                (l.dielectric, l.specular) = (Vec3::new(0.1, 0.05, 0.2), 0.8);
                (l.coat, l.coat_roughness) = (0.6, 0.4);
                (l.sheen_color, l.sheen_roughness) = (Vec3::new(0.2, 0.3, 0.4), 0.6);
                (l.anisotropy, l.anisotropy_rotation) = (0.5, -1.0);
            }),
        ),
    ]
}

#[test]
fn layers() {
    assert_all_agree(|| {
        let case = |(name, material): (&'static str, Material)| {
            Case::new(name, stage(material.clone(), material), colourful())
        };
        layered_materials().into_iter().map(case).collect()
    });
}

/// A block of a material above a floor, which it does not touch.
fn over_floor(material: Material) -> Scene {
    let mut scene = scene_of(vec![matt(0.6), material]);
    floor(&mut scene, 6.0, 0.0, 0);
    cuboid(&mut scene, Vec3::new(-0.9, 0.1, -0.5), Vec3::new(0.1, 0.9, 0.4), 1);
    scene
}

/// What is seen through glass, thin and solid, smooth and rough, and in its shadow.
#[test]
fn glass() {
    assert_all_agree(|| {
        let with = |glass: Glass, roughness: f32, color: Vec3| Material {
            base_color: color.extend(1.0),
            roughness,
            double_sided: glass.solid,
            glass: Some(glass),
            ..matt(1.0)
        };
        let thin =
            Glass { transmission: 1.0, texture: None, ior: 1.5, solid: false, attenuation: Vec3::ZERO };
        let solid = Glass { solid: true, attenuation: Vec3::new(0.2, 1.0, 2.0), ..thin };
        let case = |name, glass, roughness, color| Case {
            paths: 16_000,
            ..Case::new(name, over_floor(with(glass, roughness, color)), colourful())
        };
        vec![
            case("thin glass", thin, 0.0, Vec3::ONE),
            case("thin frosted glass", Glass { transmission: 0.7, ..thin }, 0.5, Vec3::new(0.9, 0.6, 0.3)),
            case("solid glass", solid, 0.0, Vec3::ONE),
            case(
                "solid rough glass of index 1.8",
                Glass { ior: 1.8, ..solid },
                0.4,
                Vec3::new(0.5, 0.9, 0.7),
            ),
        ]
    });
}

/// Each texture of layers, as the kernels and the reference read it.
#[test]
fn textured_layers() {
    assert_all_agree(|| {
        let mut scene = speckled();
        for (index, material) in scene.materials.iter_mut().enumerate() {
            let use_of = |texture: u32| mapped(texture, 0.3);
            // As the loader has it: glossy surfaces have no metalness.
            material.metallic *= if index == 1 { 0.0 } else { 1.0 };
            material.layers = Some(Box::new(Layers {
                dielectric: Vec3::splat(0.5),
                specular: 0.9,
                specular_color_texture: use_of(0),
                specular_texture: use_of(1),
                coat: 0.8,
                coat_texture: use_of(1),
                coat_roughness: 0.9,
                coat_roughness_texture: use_of(1),
                coat_normal_texture: use_of(2),
                sheen_color: Vec3::splat(0.5),
                sheen_color_texture: use_of(0),
                sheen_roughness: 0.9,
                sheen_roughness_texture: use_of(1),
                anisotropy: if index == 0 { 0.8 } else { 0.0 },
                anisotropy_rotation: 0.5,
                anisotropy_texture: use_of(2),
                glossy: index == 1,
                ..Layers::default()
            }));
        }
        vec![Case::new("textured layers", scene, colourful())]
    });
}

/// Seen nearly along the floor, where Fresnel reflection is strong; red metal has no F0 in green and blue.
#[test]
fn grazing_views() {
    let low = || view(DVec3::new(0.0, 0.12, 4.0), DVec3::new(0.0, 0.0, 0.0), 6.0, (960, 640));
    assert_all_agree(|| {
        let red = metal(Vec3::X, 0.3);
        let water = Material { roughness: 0.15, ..matt(0.02) };
        let case = |name, material: Material| Case {
            view: low(),
            ..Case::new(name, stage(material.clone(), material), colourful())
        };
        vec![case("red metal", red), case("dark dielectric", water)]
    });
}

#[test]
fn environments() {
    assert_all_agree(|| {
        let half = sky(|_, y| Vec3::splat(if y < 8 { 2.0 } else { 0.0 }));
        let side = sky(|x, _| Vec3::splat(if x < 16 { 2.0 } else { 0.0 }));
        let spot = sky(|x, y| Vec3::splat(if (x, y) == (20, 3) { 1e6 } else { 0.0 }));
        let glare = sky(|x, y| Vec3::splat(if (x, y) == (9, 2) { 1e9 } else { 1e-6 }));
        let plastic = || Material { roughness: 0.3, ..matt(0.5) };
        let case = |name, light| Case::new(name, stage(matt(0.6), plastic()), light);
        vec![
            case("constant map", Environment::constant(Vec3::new(0.2, 1.0, 3.0))),
            case("black map", dark()),
            case("upper half of a map", half),
            case("left half of a map", side),
            case("one bright texel", spot),
            case("map of 1e-6", Environment::constant(Vec3::splat(1e-6))),
            case("map of 1e9", Environment::constant(Vec3::splat(1e9))),
            case("a texel of 1e9 in a map of 1e-6", glare),
        ]
    });
}

/// A sun in a black sky on smooth surfaces: the sun's rays have to find the narrow lobe.
#[test]
fn suns() {
    assert_all_agree(|| {
        // The floor mirrors it into the middle of the view.
        let direction = Vec3::new(0.1, 1.2, -3.0).normalize();
        let sun = |radius: f32, radiance: f32| Environment {
            sun: Some(Sun {
                direction,
                cos_radius: radius.to_radians().cos(),
                radiance: Vec3::splat(radiance),
            }),
            ..dark()
        };
        let case = |name, angle, material: Material, light| {
            let view = view(DVec3::new(0.1, 1.2, 3.0), DVec3::new(0.2, 0.0, 0.0), angle, (960, 640));
            let mut scene = scene_of(vec![material]);
            floor(&mut scene, 6.0, 0.0, 0);
            Case { view, grid: Some(80), ..Case::new(name, scene, light) }
        };
        vec![
            case("sun on plastic", 12.0, Material { roughness: 0.3, ..matt(0.5) }, sun(0.27, 1e4)),
            case("sun on polished metal", 12.0, metal(Vec3::ONE, 0.1), sun(0.27, 1e4)),
            case("large sun on polished metal", 20.0, metal(Vec3::ONE, 0.1), sun(8.0, 5.0)),
            case("sun of 1e9", 12.0, Material { roughness: 0.3, ..matt(0.5) }, sun(0.27, 1e9)),
            case("sun in a mirror", 1.0, metal(Vec3::ONE, 0.0), sun(0.27, 1e4)),
            case("small sun on gloss", 4.0, Material { roughness: 0.15, ..matt(0.1) }, sun(0.03, 1e6)),
        ]
    });
}

/// A round thing of few triangles: rays leave it from where its normals describe it.
#[test]
fn round_things() {
    assert_all_agree(|| {
        let round = |material| {
            let mut scene = round_ball(1, material);
            floor(&mut scene, 6.0, -0.6, 0);
            scene
        };
        let sunny = || Sky { sun_elevation_deg: 20.0, sun_azimuth_deg: 90.0, ..Sky::default() }.bake();
        let mut lit = round(matt(0.6));
        lit.lights = lights();
        vec![
            Case::new("round, under sky and sun", round(matt(0.6)), sunny()),
            Case { bounces: 1, ..Case::new("round, one bounce", round(matt(0.6)), colourful()) },
            Case::new("round and glossy", round(metal(Vec3::new(1.0, 0.7, 0.3), 0.3)), colourful()),
            Case::new("round, punctual lights", lit, dark()),
        ]
    });
}

fn speckled() -> Scene {
    let grain = |i: u32, k: u32| (60 + (i * 97 + k * 53) % 180) as u8;
    let colours = texture(true, |i| [grain(i, 1), grain(i, 2), grain(i, 3), 255]);
    let roughness = texture(false, |i| [255, grain(i, 4), grain(i, 5) / 2, 255]);
    let bumps = texture(false, |i| [90 + (i * 37 % 80) as u8, 90 + (i * 59 % 80) as u8, 230, 255]);
    let shade = texture(false, |i| [grain(i, 6), 0, 0, 255]);
    let material = Material {
        base_color_texture: mapped(0, 5.0),
        metallic_roughness_texture: mapped(1, 3.0),
        metallic: 0.9,
        roughness: 0.9,
        normal_texture: mapped(2, 4.0),
        normal_scale: 1.3,
        occlusion_texture: mapped(3, 2.0),
        occlusion_strength: 0.7,
        emissive: Vec3::new(0.1, 0.05, 0.2),
        emissive_texture: mapped(0, 2.0),
        ..Material::default()
    };
    let mut scene = stage(material.clone(), material);
    scene.textures = vec![colours, roughness, bumps, shade];
    scene
}

#[test]
fn textures() {
    let sunny = || {
        let sun = Sun {
            direction: Vec3::new(0.6, 0.5, 0.4).normalize(),
            cos_radius: 0.999,
            radiance: Vec3::splat(300.0),
        };
        Environment { sun: Some(sun), ..colourful() }
    };
    assert_all_agree(|| {
        let mut coloured = stage(matt(0.8), matt(0.5));
        let tint = |i: usize| Vec4::new(1.0, (i % 3) as f32 / 3.0, (i % 5) as f32 / 5.0, 1.0);
        coloured.mesh.colors = (0..coloured.mesh.positions.len()).map(tint).collect();
        // Normals that lean over so far that some face away from a low viewer.
        let mut wavy = speckled();
        wavy.materials.iter_mut().for_each(|m| m.normal_scale = 6.0);
        let low = view(DVec3::new(0.0, 0.3, 4.0), DVec3::new(0.0, 0.0, 1.0), 10.0, (960, 640));
        vec![
            Case::new("all textures", speckled(), sunny()),
            Case { view: low, ..Case::new("steep normal map", wavy, colourful()) },
            Case::new("vertex colours", coloured, colourful()),
        ]
    });
}

/// Pierced and half-transparent panes between the eye and the floor, and between the floor and the light.
fn panes(alpha: AlphaMode) -> Scene {
    let holes = texture(true, |i| [200, 150, 100, if i % 3 == 0 { 40 } else { 220 }]);
    let pane = Material { alpha, double_sided: true, base_color_texture: mapped(0, 3.0), ..matt(0.8) };
    let mut scene = stage(matt(0.6), pane);
    scene.textures = vec![holes];
    let upright = [[-1.0, 0.0], [1.3, 0.0], [1.3, 1.1], [-1.0, 1.1]];
    quad(&mut scene, upright.map(|[x, y]| Vec3::new(x, y, 1.1)), 1);
    quad(&mut scene, upright.map(|[x, z]| Vec3::new(x, 1.4, -z)), 1);
    scene
}

#[test]
fn alpha() {
    let light = || {
        let sun = Sun {
            direction: Vec3::new(0.1, 0.9, -0.2).normalize(),
            cos_radius: 0.99,
            radiance: Vec3::splat(30.0),
        };
        Environment { sun: Some(sun), ..colourful() }
    };
    assert_all_agree(|| {
        let mut lit = panes(AlphaMode::Blend);
        lit.lights = lights();
        vec![
            Case { paths: 16_000, ..Case::new("MASK", panes(AlphaMode::Mask(0.5)), light()) },
            Case { paths: 16_000, ..Case::new("BLEND", panes(AlphaMode::Blend), light()) },
            Case::new("BLEND before punctual lights", lit, dark()),
            Case {
                bounces: 1,
                paths: 16_000,
                ..Case::new("BLEND, one bounce", panes(AlphaMode::Blend), light())
            },
        ]
    });
}

pub fn lights() -> Vec<Light> {
    let light = |kind, intensity: f32, position: Vec3| Light {
        kind,
        intensity: Vec3::new(intensity, 0.8 * intensity, 0.5 * intensity),
        position,
        direction: (Vec3::new(0.2, 0.0, 0.1) - position).normalize(),
        range: f32::INFINITY,
    };
    let spot = LightKind::Spot { cos_inner: 0.97, cos_outer: 0.8 };
    vec![
        light(LightKind::Point, 5.0, Vec3::new(1.5, 1.2, 0.9)),
        Light { range: 3.0, ..light(LightKind::Point, 9.0, Vec3::new(-1.4, 1.0, 1.2)) },
        light(spot, 20.0, Vec3::new(0.6, 3.0, 1.0)),
        light(LightKind::Directional, 0.7, Vec3::new(1.0, 2.0, -0.5)),
    ]
}

#[test]
fn punctual_lights() {
    assert_all_agree(|| {
        let plastic = Material { roughness: 0.5, ..matt(0.5) };
        let mut scene = stage(plastic.clone(), plastic);
        scene.lights = lights();
        // The same a million times smaller, lights and all: irradiance grows by 1e12.
        let mut tiny = scene.clone();
        let shrink = |p: &mut Vec3| *p *= 1e-6;
        tiny.mesh.positions.iter_mut().for_each(shrink);
        tiny.lights.iter_mut().for_each(|light| {
            shrink(&mut light.position);
            light.range *= 1e-6;
        });
        let mut case = Case::new("punctual lights", scene.clone(), dark());
        case.paths = 100;
        let mut small = Case { paths: 100, ..Case::new("tiny punctual lights", tiny, dark()) };
        small.view.world_from_eye.position *= 1e-6;
        let sky = Case::new("punctual lights and a sky", scene, colourful());
        vec![case, small, sky]
    });
}

/// A room of 4x3x4 m without a front wall, a lamp under its ceiling, a block on its floor.
fn room(walls: Material, block: Material) -> Scene {
    let lamp = Material { emissive: Vec3::new(8.0, 7.0, 5.0), ..matt(0.0) };
    let mut scene = stage(walls, block);
    scene.materials.push(lamp);
    scene.materials.push(Material { base_color: Vec4::new(0.7, 0.1, 0.1, 1.0), ..matt(0.0) });
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    quad(&mut scene, [at(-2.0, 0.0, -2.0), at(2.0, 0.0, -2.0), at(2.0, 3.0, -2.0), at(-2.0, 3.0, -2.0)], 0);
    quad(&mut scene, [at(-2.0, 0.0, 2.0), at(-2.0, 0.0, -2.0), at(-2.0, 3.0, -2.0), at(-2.0, 3.0, 2.0)], 3);
    quad(&mut scene, [at(2.0, 0.0, -2.0), at(2.0, 0.0, 2.0), at(2.0, 3.0, 2.0), at(2.0, 3.0, -2.0)], 0);
    quad(&mut scene, [at(-0.8, 2.9, -0.8), at(0.8, 2.9, -0.8), at(0.8, 2.9, 0.8), at(-0.8, 2.9, 0.8)], 2);
    scene
}

#[test]
fn bounces() {
    assert_all_agree(|| {
        let glossy = Material { roughness: 0.3, metallic: 0.5, ..matt(0.7) };
        let case = |name, bounces, light| Case {
            bounces,
            paths: 30_000,
            ..Case::new(name, room(matt(0.7), glossy.clone()), light)
        };
        let sunny = || Environment {
            sun: Some(Sun {
                direction: Vec3::new(-0.3, 0.8, 1.2).normalize(),
                cos_radius: 0.999,
                radiance: Vec3::splat(800.0),
            }),
            ..colourful()
        };
        let mut lit = case("one bounce of punctual lights", 1, dark());
        lit.scene.lights = lights();
        vec![
            case("emission seen, no bounce", 0, colourful()),
            case("one bounce of emission", 1, dark()),
            case("one bounce of emission and sky", 1, colourful()),
            case("two bounces of emission, sky and sun", 2, sunny()),
            lit,
        ]
    });
}

/// The room with a lamp that is drawn from a texture, on both sides, beside a blended one.
fn textured_lamps() -> Scene {
    let mut scene = room(matt(0.7), matt(0.4));
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    scene.textures = vec![texture(true, |i| [(i * 67 % 256) as u8, 200, (i * 29 % 256) as u8, 255])];
    let drawn = Material {
        emissive: Vec3::splat(6.0),
        emissive_texture: mapped(0, 1.0),
        double_sided: true,
        ..matt(0.3)
    };
    let blended = Material {
        emissive: Vec3::new(2.0, 5.0, 9.0),
        alpha: AlphaMode::Blend,
        base_color: Vec4::new(0.2, 0.2, 0.2, 0.4),
        ..matt(0.2)
    };
    scene.materials[2] = drawn;
    scene.materials.push(blended);
    // Beside what is seen: seen itself, it would be a coin toss in each picture.
    quad(&mut scene, [at(-1.9, 0.5, 1.95), at(-1.9, 0.5, 1.2), at(-1.9, 1.7, 1.2), at(-1.9, 1.7, 1.95)], 4);
    scene
}

/// A room with more lamps than there are rays.
fn many_lamps() -> Scene {
    let mut scene = room(matt(0.7), Material { roughness: 0.2, ..matt(0.4) });
    for i in 0..120 {
        let (x, z) = ((i % 12) as f32 * 0.3 - 1.7, (i / 12) as f32 * 0.35 - 1.8);
        let (low, high) = (Vec3::new(x, 2.4, z), Vec3::new(x + 0.1, 2.5, z + 0.1));
        cuboid(&mut scene, low, high, 2);
    }
    scene
}

#[test]
fn emitters() {
    assert_all_agree(|| {
        let glossy = Material { roughness: 0.2, metallic: 0.6, ..matt(0.7) };
        let case = |name, scene, light| Case { paths: 60_000, ..Case::new(name, scene, light) };
        let shell = Material {
            unlit: true,
            double_sided: true,
            base_color: Vec4::new(0.5, 0.8, 1.0, 1.0),
            ..matt(0.0)
        };
        let mut dome = stage(matt(0.6), glossy.clone());
        dome.materials.push(shell);
        cuboid(&mut dome, Vec3::splat(-9.0), Vec3::splat(9.0), 2);
        dome.lights = self::lights();
        let mut lights = stage(matt(0.6), glossy.clone());
        let ring = |i: i32| Light {
            kind: LightKind::Point,
            intensity: Vec3::new(1.0, 0.5 + 0.1 * (i % 4) as f32, 0.3),
            position: Vec3::new((i as f32).cos() * 2.0, 0.6 + 0.1 * i as f32, (i as f32).sin() * 2.0),
            direction: Vec3::NEG_Y,
            range: f32::INFINITY,
        };
        lights.lights = (0..14).map(ring).chain(self::lights()).collect();
        let exact = Case { paths: 100, ..Case::new("more lights than are all asked", lights, dark()) };
        let grid =
            Case { grid: Some(120), ..case("one lamp, on a grid", room(matt(0.7), matt(0.4)), dark()) };
        vec![
            case("one lamp", room(matt(0.7), glossy), dark()),
            grid,
            case("textured and blended lamps, and a sky", textured_lamps(), colourful()),
            case("many lamps", many_lamps(), dark()),
            case("an unlit dome around lights", dome, colourful()),
            exact,
        ]
    });
}

#[test]
fn emission_and_unlit() {
    assert_all_agree(|| {
        let unlit = Material { unlit: true, emissive: Vec3::ONE, ..metal(Vec3::new(0.9, 0.4, 0.1), 0.5) };
        let glowing = Material { emissive: Vec3::new(3.0, 1.0, 0.2), ..matt(0.3) };
        let over = |material: Material| {
            let mut scene = stage(matt(0.5), material);
            cuboid(&mut scene, Vec3::new(0.4, 0.0, -0.6), Vec3::new(1.2, 1.0, 0.2), 1);
            scene
        };
        let case = |name, material, bounces| Case { bounces, ..Case::new(name, over(material), colourful()) };
        vec![
            case("unlit", unlit.clone(), 0),
            case("glowing", glowing.clone(), 0),
            case("unlit, one bounce", unlit, 1),
            Case { paths: 16_000, ..case("glowing, one bounce", glowing, 1) },
        ]
    });
}

/// The scene far from the anchor, and seen by an eye far from the world's origin.
#[test]
fn places() {
    assert_all_agree(|| {
        let moved = |by: DVec3, anchor: DVec3| {
            let mut case = floor_under_sky();
            case.scene.mesh.positions.iter_mut().for_each(|p| *p += by.as_vec3());
            case.scene.anchor = anchor;
            let View { world_from_eye, .. } = &mut case.view;
            world_from_eye.position += by + anchor;
            case
        };
        vec![
            Case { name: "300 m from the anchor", ..moved(DVec3::new(300.0, 16.0, -40.0), DVec3::ZERO) },
            Case { name: "1e7 m from the origin", ..moved(DVec3::ZERO, DVec3::new(1e7, 2e6, -3e6)) },
        ]
    });
}
