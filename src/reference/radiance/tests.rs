//! Scenes whose radiance is known in closed form.

use glam::{Mat2, Vec2, Vec3, Vec4};

use super::*;
use crate::math::{pose::Pose, view::FieldOfView};
use crate::reference::testing::{constant_light, floor, quad, scene_of};
use crate::scene::{AlphaMode, Light, LightKind, Material, Texture, TextureRef, texture::Wrap};

fn rough(color: f32, metallic: f32) -> Material {
    Material { base_color: Vec4::new(color, color, color, 1.0), metallic, ..Material::default() }
}

fn emitter(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..rough(0.0, 1.0) }
}

/// Straight down onto a floor, not onto its diagonal.
fn down() -> Ray {
    Ray { origin: DVec3::new(0.0, 1.0, 0.125), direction: DVec3::NEG_Y }
}

fn dark() -> Environment {
    constant_light(0.0)
}

fn point_light(x: f32, y: f32, z: f32) -> Light {
    Light {
        kind: LightKind::Point,
        intensity: Vec3::splat(4.0),
        position: Vec3::new(x, y, z),
        direction: Vec3::NEG_Y,
        range: f32::INFINITY,
    }
}

/// An estimate is within five standard errors: a false alarm once in 1.7 million seeds; and those
/// errors are small enough to tell.
fn assert_estimates(estimate: Estimate, expected: f64, resolution: f64) {
    let (mean, error) = (estimate.mean.x, estimate.standard_error.x);
    assert!((mean - expected).abs() <= 5.0 * error + 1e-9, "{mean} is not {expected} (error {error})");
    assert!(error <= resolution * expected.abs(), "error {error} tells nothing");
}

/// Reflectance of a floor with GGX α = 1 seen from straight above under light of 1 from everywhere:
/// with x = cos θ, `∫ [(1 - F)(1 - m) c / π + F / (2π (1 + x))] x 2π dx`.
fn furnace(color: f64, metallic: f64) -> f64 {
    let f0 = 0.04 + (color - 0.04) * metallic;
    let integrand = |x: f64| {
        let fresnel = f0 + (1.0 - f0) * (1.0 - ((1.0 + x) / 2.0).sqrt()).powi(5);
        2.0 * (1.0 - fresnel) * (1.0 - metallic) * color * x + fresnel * x / (1.0 + x)
    };
    let n = 1000;
    let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
    (0..=n).map(|i| weight(i) * integrand(f64::from(i) / f64::from(n))).sum::<f64>() / f64::from(3 * n)
}

#[test]
fn furnace_has_its_known_value() {
    for (color, metallic) in [(1.0, 0.0), (0.3, 0.0), (0.8, 1.0), (0.5, 0.5)] {
        let scene = floor(10.0, rough(color, metallic));
        let light = constant_light(2.0);
        let renderer = Renderer::new(&scene, &light);
        let expected = 2.0 * furnace(f64::from(color), f64::from(metallic));
        let summed = renderer.direct_by_quadrature(&down(), 200).x;
        assert!((summed - expected).abs() < 1e-4 * expected, "{summed} is not {expected}");
        assert_estimates(renderer.radiance(&down(), 20_000, &mut Random::new(1)), expected, 0.01);
    }
}

#[test]
fn smooth_white_metal_mirrors_the_map() {
    let material = Material { roughness: 0.0, ..rough(1.0, 1.0) };
    let scene = floor(10.0, material);
    let light = constant_light(3.0);
    let renderer = Renderer::new(&scene, &light);
    let slanted = Ray { origin: DVec3::new(-1.0, 1.0, 0.125), direction: DVec3::new(1.0, -1.0, 0.0) };
    let estimate = renderer.radiance(&slanted, 20_000, &mut Random::new(2));
    assert!((estimate.mean.x / 3.0 - 1.0).abs() < 0.02 && estimate.standard_error.x < 0.03, "{estimate:?}");
}

#[test]
fn no_reflection_sends_more_than_it_gets() {
    // The sum of diffuse and specular light may: the model's Fresnel term knows one microfacet only.
    let light = constant_light(1.0);
    for (color, metallic) in [(1.0, 1.0), (0.0, 0.0)] {
        for roughness in [0.2, 0.5, 1.0] {
            for slope in [0.2, 1.0, 5.0] {
                let scene = floor(100.0, Material { roughness, ..rough(color, metallic) });
                let ray =
                    Ray { origin: DVec3::new(-slope, 1.0, 0.3), direction: DVec3::new(slope, -1.0, 0.0) };
                let estimate = Renderer::new(&scene, &light).radiance(&ray, 4000, &mut Random::new(3));
                let most = 1.0 + 5.0 * estimate.standard_error.x;
                assert!(estimate.mean.x < most, "{metallic} {roughness} {slope}: {estimate:?}");
            }
        }
    }
}

#[test]
fn sun_lights_a_floor_by_the_cosine() {
    let cosine = 0.6f64;
    let sun = Sun {
        direction: Vec3::new(0.8, 0.6, 0.0),
        cos_radius: 0.267f32.to_radians().cos(),
        radiance: Vec3::splat(2e4),
    };
    let light = Environment { sun: Some(sun), ..dark() };
    let seen = |color: f32| {
        let scene = floor(10.0, rough(color, 0.0));
        let renderer = Renderer::new(&scene, &light);
        let estimate = renderer.radiance(&down(), 1000, &mut Random::new(4));
        (renderer.direct_by_quadrature(&down(), 20).x, estimate)
    };
    // Base colour matters to the diffuse part only, so the difference of two is (1 - F) / π E cos θ.
    let irradiance = 2e4 * light::sun_solid_angle(&sun);
    let half_angle = ((1.0 + cosine) / 2.0).sqrt();
    let fresnel = 0.04 + 0.96 * (1.0 - half_angle).powi(5);
    let expected = (1.0 - fresnel) / PI * irradiance * cosine * 0.7;
    let (bright, dim) = (seen(0.9), seen(0.2));
    let found = bright.0 - dim.0;
    assert!((found - expected).abs() < 1e-4 * expected, "{found} is not {expected}");
    assert_estimates(bright.1, bright.0, 0.001);
    // A roof hides the sun; a single-sided one that shows its back does so too.
    let mut scene = floor(10.0, rough(0.9, 0.0));
    let roof = floor(10.0, rough(0.9, 0.0)).mesh.positions;
    quad(&mut scene, [roof[0], roof[1], roof[2], roof[3]].map(|p| p + 5.0 * Vec3::Y), 0);
    assert_eq!(Renderer::new(&scene, &light).direct_by_quadrature(&down(), 4), DVec3::ZERO);
}

#[test]
fn wall_takes_half_of_the_light() {
    let mut scene = floor(10.0, rough(0.7, 0.0));
    let wall = Material { double_sided: true, ..rough(0.0, 1.0) };
    scene.materials.push(wall);
    let (x, far) = (1e-4, 1e4);
    let corners = [[-far, far], [-far, -far], [far, -far], [far, far]];
    quad(&mut scene, corners.map(|[z, y]| Vec3::new(x, y, z)), 1);
    let light = constant_light(1.0);
    let renderer = Renderer::new(&scene, &light);
    let expected = 0.5 * furnace(0.7f32.into(), 0.0);
    let summed = renderer.direct_by_quadrature(&down(), 200).x;
    assert!((summed - expected).abs() < 2e-3 * expected, "{summed} is not {expected}");
    assert_estimates(renderer.radiance(&down(), 60_000, &mut Random::new(5)), expected, 0.01);
}

#[test]
fn punctual_light_is_hidden_by_what_is_nearer_than_it() {
    let mut scene = floor(10.0, rough(0.5, 0.0));
    scene.lights = vec![point_light(0.0, 2.0, 0.125)];
    // E = 4 / 2² = 1 from straight above: the BRDF's value there.
    let expected = (0.96 * 0.5 + 0.04 / 4.0) / PI;
    let light = dark();
    let found = Renderer::new(&scene, &light).direct_by_quadrature(&down(), 1).x;
    assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
    let roof = |y: f32| {
        let mut scene = scene.clone();
        let positions = scene.mesh.positions.clone();
        // Its front faces up, but the camera starts below it.
        quad(
            &mut scene,
            [positions[0], positions[1], positions[2], positions[3]].map(|p| p + y * Vec3::Y),
            0,
        );
        Renderer::new(&scene, &light).radiance(&down(), 2, &mut Random::new(6)).mean.x
    };
    assert_eq!(roof(1.5), 0.0);
    assert!((roof(2.5) - expected).abs() < 1e-6);
}

#[test]
fn occlusion_dims_the_map_only() {
    let plain = Material { emissive: Vec3::splat(0.25), ..rough(0.5, 0.0) };
    let reference = TextureRef { texture: 0, uv_slot: 0, matrix: Mat2::IDENTITY, offset: Vec2::ZERO };
    let occluded = Material { occlusion_texture: Some(reference), occlusion_strength: 0.5, ..plain.clone() };
    let black = Texture {
        texels: vec![[0, 0, 0, 255]].into(),
        width: 1,
        height: 1,
        srgb: false,
        wrap: [Wrap::Repeat; 2],
        nearest: false,
    };
    let sun = Sun { direction: Vec3::Y, cos_radius: 0.999, radiance: Vec3::splat(50.0) };
    let seen = |material: &Material, radiance: f32, lit: bool| {
        let mut scene = floor(10.0, material.clone());
        scene.textures = vec![black.clone()];
        if lit {
            scene.lights = vec![point_light(0.5, 2.0, 0.0)];
        }
        let light = Environment { sun: lit.then_some(sun), ..constant_light(radiance) };
        Renderer::new(&scene, &light).direct_by_quadrature(&down(), 50).x
    };
    let map = seen(&plain, 1.0, false) - 0.25;
    assert!((seen(&occluded, 1.0, false) - (0.25 + 0.5 * map)).abs() < 1e-9);
    assert_eq!(seen(&occluded, 0.0, true), seen(&plain, 0.0, true));
    assert!(seen(&plain, 0.0, true) > 0.3);
}

#[test]
fn unlit_and_background_are_seen_as_they_are() {
    let unlit = Material { unlit: true, emissive: Vec3::ONE, ..rough(0.3, 0.0) };
    let scene = floor(10.0, unlit);
    let sun = Sun { direction: Vec3::Y, cos_radius: 0.99, radiance: Vec3::splat(7.0) };
    let light = Environment { sun: Some(sun), ..constant_light(2.0) };
    let renderer = Renderer::new(&scene, &light);
    let mut random = Random::new(7);
    let mut seen = |ray: Ray| renderer.radiance(&ray, 3, &mut random);
    assert!((seen(down()).mean.x - 0.3).abs() < 1e-6);
    let up = Ray { direction: DVec3::Y, ..down() };
    assert_eq!((seen(up).mean.x, seen(up).standard_error.x), (9.0, 0.0));
    assert_eq!(seen(Ray { direction: DVec3::X, ..down() }).mean.x, 2.0);
}

#[test]
fn blend_layers_mix_what_they_cover() {
    let glass =
        Material { alpha: AlphaMode::Blend, base_color: Vec4::new(0.0, 0.0, 0.0, 0.25), ..emitter(4.0) };
    let mut scene = floor(10.0, emitter(8.0));
    scene.materials.push(glass);
    let p = scene.mesh.positions.clone();
    quad(&mut scene, [p[0], p[1], p[2], p[3]].map(|p| p + 0.5 * Vec3::Y), 1);
    quad(&mut scene, [p[0], p[1], p[2], p[3]].map(|p| p + 0.75 * Vec3::Y), 1);
    let light = dark();
    let renderer = Renderer::new(&scene, &light);
    let expected = 0.25 * 4.0 + 0.75 * (0.25 * 4.0 + 0.75 * 8.0);
    assert!((renderer.radiance(&down(), 2, &mut Random::new(8)).mean.x - expected).abs() < 1e-6);
}

/// The inside of a cube of 2 m.
fn room(material: Material) -> Scene {
    let mut scene = scene_of(material);
    for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
        let (a, b) = axis.any_orthonormal_pair();
        let (a, b) = if a.cross(b).dot(axis) < 0.0 { (a, b) } else { (b, a) };
        quad(&mut scene, [axis - a - b, axis + a - b, axis + a + b, axis - a + b], 0);
    }
    scene
}

#[test]
fn each_bounce_in_a_glowing_mirror_room_adds_its_glow() {
    // The glow of what the first surface reflects is direct light.
    let material = Material { roughness: 0.1, emissive: Vec3::ONE, ..rough(1.0, 1.0) };
    let scene = room(material);
    let light = dark();
    let mut renderer = Renderer::new(&scene, &light);
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::new(0.3, 0.9, 0.2) };
    for bounces in [0, 1, 3] {
        renderer.bounces = bounces;
        let estimate = renderer.radiance(&ray, 20_000, &mut Random::new(9));
        let expected = f64::from(2 + bounces);
        // A rough metal loses a little to masking, here well under one per cent a bounce.
        let slack = 0.01 * f64::from(1 + bounces) + 5.0 * estimate.standard_error.x;
        assert!((estimate.mean.x - expected).abs() <= slack, "{bounces}: {estimate:?}");
        assert!(estimate.standard_error.x < 0.06);
    }
}

#[test]
fn a_floor_gathers_what_a_ceiling_sends() {
    // A floor that sees only a glowing ceiling is in a furnace, without any bounce.
    let mut scene = floor(10.0, rough(0.6, 0.0));
    scene.materials.push(Material { double_sided: true, ..emitter(2.0) });
    let far = 1e5;
    let corners = [[-far, -far], [far, -far], [far, far], [-far, far]];
    quad(&mut scene, corners.map(|[x, z]| Vec3::new(x, 3.0, z)), 1);
    let light = constant_light(1.0);
    let estimate = Renderer::new(&scene, &light).radiance(&down(), 20_000, &mut Random::new(10));
    let mut dim = scene.clone();
    dim.materials[1].emissive = Vec3::ZERO;
    let under = Renderer::new(&dim, &light).radiance(&down(), 2000, &mut Random::new(10));
    assert!(under.mean.x < 1e-3, "the ceiling hides the map: {under:?}");
    let ceiling = 2.0;
    assert_estimates(estimate, ceiling * furnace(0.6f32.into(), 0.0), 0.01);
}

#[test]
fn estimators_agree_under_an_uneven_map() {
    let texels =
        (0..32 * 16).map(|i| Vec3::splat(if i == 3 * 32 + 20 { 200.0 } else { (i % 5) as f32 })).collect();
    let light = Environment { width: 32, height: 16, texels, sun: None };
    let scene = floor(10.0, Material { roughness: 0.6, ..rough(0.5, 0.3) });
    let renderer = Renderer::new(&scene, &light);
    let ray = Ray { origin: DVec3::new(-1.0, 1.0, 0.125), direction: DVec3::new(1.0, -1.0, 0.1) };
    let summed = renderer.direct_by_quadrature(&ray, 500).x;
    assert_estimates(renderer.radiance(&ray, 100_000, &mut Random::new(11)), summed, 0.01);
}

#[test]
fn pictures_are_relative_to_the_anchor_and_repeatable() {
    let mut scene = floor(1.0, emitter(1.0));
    scene.anchor = DVec3::new(1e7, -2e6, 3e6);
    let light = dark();
    let renderer = Renderer::new(&scene, &light);
    let eye = scene.anchor + DVec3::new(0.0, 2.0, 0.0);
    let view = View {
        world_from_eye: Pose::look_at(eye, scene.anchor),
        fov: FieldOfView::symmetric(2.0 * 1.0f64.atan(), 1.0),
        width: 8,
        height: 8,
        spacing: Default::default(),
    };
    let picture = renderer.picture(&view, 2, 1);
    // At 2 m a view of 90 degrees is 4 m wide: the floor covers the inner 4x4 pixels.
    let lit: Vec<bool> = picture.iter().map(|pixel| pixel.mean.x > 0.5).collect();
    for (index, lit) in lit.iter().enumerate() {
        let inside = |i: usize| (2..6).contains(&i);
        assert_eq!(*lit, inside(index % 8) && inside(index / 8), "{index}");
    }
    assert_eq!(picture, renderer.picture(&view, 2, 1));
}

#[test]
fn estimate_knows_its_error() {
    let estimate = Estimate::of([1.0, 2.0, 3.0, 4.0].map(DVec3::splat));
    assert_eq!(estimate.mean.x, 2.5);
    assert!((estimate.standard_error.x - (5.0f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
    assert_eq!(Estimate::of([DVec3::ONE]).standard_error.x, f64::INFINITY);
    assert_eq!(Estimate::of([]).samples, 0);
}

/// A ball of few triangles with a ball's normals: where these face a light it is seen, and nowhere else; rays start on the
/// ball's side of its triangles, by no more than the ball is higher, twice.
#[test]
fn round_things_do_not_shadow_themselves() {
    let (rings, columns) = (6u32, 9u32);
    let mut scene = scene_of(rough(0.5, 0.0));
    for ring in 0..=rings {
        for column in 0..columns {
            let (theta, phi) =
                (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(column) / f64::from(columns));
            let across = if ring == 0 || ring == rings { 0.0 } else { theta.sin() };
            let p = DVec3::new(across * phi.cos(), theta.cos(), across * phi.sin());
            scene.mesh.positions.push(p.as_vec3() * 2.0);
            scene.mesh.normals.push(p.as_vec3());
        }
    }
    for ring in 0..rings {
        for column in 0..columns {
            let at = |ring: u32, column: u32| ring * columns + column % columns;
            let [a, b, c, d] = [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(r, k)| at(ring + r, column + k));
            let upper = (ring > 0).then_some([a, b, c]);
            let lower = (ring + 1 < rings).then_some([a, c, d]);
            scene.mesh.triangles.extend(upper.into_iter().chain(lower));
        }
    }
    scene.mesh.materials = vec![0; scene.mesh.triangles.len()];
    let tracer = Tracer::new(&scene);
    let mut random = Random::new(5);
    let (mut lit, mut hidden, mut below) = (0, 0, 0);
    for _ in 0..20_000 {
        let on_sphere = |random: &mut Random| crate::reference::testing::on_sphere(random);
        let (from, direction) = (on_sphere(&mut random) * 5.0, on_sphere(&mut random));
        let ray = Ray { origin: from, direction: -from.normalize() };
        let hit = tracer.closest(&ray, f64::INFINITY).expect("towards the middle");
        let surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
        let rises = (surface.spawn(direction).origin - surface.position).length();
        let lower = 2.0 - surface.position.length();
        assert!(rises < 2.0 * lower + 1e-6, "{rises} over what is {lower} lower");
        if surface.horizon.dot(direction) > 0.01 {
            lit += 1;
            below += usize::from(surface.geometric_normal.dot(direction) < 0.0);
            hidden += usize::from(tracer.occluded(&surface.spawn(direction), f64::INFINITY));
        } else if surface.horizon.dot(direction) < 0.0 {
            assert!(!surface.faces(direction));
        }
    }
    assert!(below > 100, "{below} directions from below their triangle");
    assert!(lit > 9000 && hidden * 1000 < lit, "{hidden} of {lit} are hidden");
}
