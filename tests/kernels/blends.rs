//! BLEND surfaces in front of each other in single guided pictures: what pixels see of them, and what they leave of the sun's
//! light and of a lamp's.

use foveate::layout::{SUN_VISIBLE, VisibilityRecord, unpack_emission};
use foveate::math::view::View;
use foveate::scene::{AlphaMode, Environment, Light, LightKind, Material, Scene};
use foveate::trace::Settings;
use glam::{DVec3, Vec3, Vec4};

use crate::bench::{Bench, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::cases;
use crate::scenes::{colourful, floor, matt, scene_of};

const SIZE: (u32, u32) = (48, 32);

fn from_above() -> View {
    view(DVec3::new(0.0, 4.0, 0.1), DVec3::ZERO, 40.0, SIZE)
}

/// A pixel with its own radiance and its neighbours' shares, in order: at a corner, in its row, in its column.
fn shown(records: &[VisibilityRecord], pixel: usize) -> Vec3 {
    let record = &records[pixel];
    let place = [0i32, 1, 2, 3, 5, 6, 7, 8][(record.normal >> 24 & 7) as usize];
    let (across, down) = (place % 3 - 1, (place / 3 - 1) * SIZE.0 as i32);
    let shares = [record.normal >> 27, record.base, record.base >> 16].map(|code| (code & 15) as f32 / 15.0);
    let light = |pixel: i32| Vec3::from(unpack_emission(records[pixel as usize].emission));
    let own = pixel as i32;
    let steps = [across + down, across, down];
    let parts = steps.iter().zip(shares).map(|(step, share)| share * light(own + step));
    light(own) * (1.0 - shares.iter().sum::<f32>()) + parts.sum::<Vec3>()
}

fn inner_pixels() -> impl Iterator<Item = usize> {
    (0..(SIZE.0 * SIZE.1) as usize).filter(|i| (2..46).contains(&(i % 48)) && (2..30).contains(&(i / 48)))
}

/// Behind up to three panes that cover a part, each pixel mixes all surfaces at once, with its neighbours' help, in their
/// shares; behind more, the last one in the mean.
#[test]
fn panes_are_smooth_in_one_picture() {
    let unlit = |color: Vec3, alpha: f32| Material {
        base_color: color.extend(alpha),
        alpha: if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque },
        unlit: true,
        double_sided: true,
        ..Material::default()
    };
    let settings = Settings { guided: true, rays: 1, edge_rays: 2, ..PLAIN };
    on_every_device(|device| {
        for (seed, alphas) in [
            &[0.3][..],
            &[0.75],
            &[0.0],
            &[0.5, 0.5],
            &[0.0, 0.35, 0.6],
            &[0.2, 0.7],
            &[0.4, 0.3, 0.5],
            &[0.3, 0.3, 0.3, 0.3],
        ]
        .into_iter()
        .enumerate()
        {
            let colors = [Vec3::X, Vec3::Z, Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.0, 0.5, 0.5)];
            let (mut materials, mut expected, mut left) = (vec![unlit(Vec3::Y, 1.0)], Vec3::ZERO, 1.0);
            for (&alpha, color) in alphas.iter().zip(colors) {
                materials.push(unlit(color, alpha));
                expected += left * alpha * color;
                left *= 1.0 - alpha;
            }
            expected += left * Vec3::Y;
            let mut scene = scene_of(materials);
            floor(&mut scene, 30.0, 0.0, 0);
            (1..=alphas.len())
                .for_each(|pane| floor(&mut scene, 30.0, 2.0 - 0.25 * pane as f32, pane as u32));
            let view = from_above();
            let settings = Settings { seed: seed as u32, ..settings };
            let picture =
                Bench::new(device, &scene, &colourful()).trace(&view, &settings, &all_pixels(&view));
            let pixels: Vec<Vec3> = inner_pixels().map(|pixel| shown(&picture.visibility, pixel)).collect();
            let mean = pixels.iter().sum::<Vec3>() / pixels.len() as f32;
            println!("{alphas:?}: {mean} for {expected}");
            assert!((mean - expected).abs().max_element() < 0.02, "{alphas:?}: {mean} for {expected}");
            if alphas.len() <= 3 {
                let worst = pixels.iter().map(|&p| (p - expected).abs().max_element()).fold(0.0, f32::max);
                assert!(worst < 0.08, "{alphas:?}: a pixel is off by {worst}");
            }
        }
    });
}

/// A gray floor below so many panes.
fn floor_below(panes: u32, alpha: f32) -> Scene {
    let pane = Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, alpha),
        alpha: AlphaMode::Blend,
        double_sided: true,
        ..Material::default()
    };
    let mut scene = scene_of(vec![matt(0.5), pane]);
    floor(&mut scene, 3.0, 0.0, 0);
    (0..panes).for_each(|i| floor(&mut scene, 90.0, 20.0 + i as f32, 1));
    scene
}

fn picture_of(device: &foveate::gpu::opencl::Device, scene: &Scene, light: &Environment) -> Picture {
    let settings = Settings { guided: true, rays: 64, edge_rays: 2, ..PLAIN };
    Bench::new(device, scene, light).trace(&from_above(), &settings, &all_pixels(&from_above()))
}

/// Below panes that cover a part all pixels know how much of the sun's light comes through, and samples do not bring it again:
/// shadows of panes are no coin tosses.
#[test]
fn panes_dim_the_sun_alike_at_all_pixels() {
    on_every_device(|device| {
        let light = cases::floor_under_sky().light;
        let sun = light.sun.unwrap();
        let irradiance = sun.radiance * (sun.solid_angle() as f32 * sun.direction.y);
        for (panes, alpha) in [(1u32, 0.3f32), (1, 0.7), (2, 0.3), (3, 0.6), (20, 0.05)] {
            let picture = picture_of(device, &floor_below(panes, alpha), &light);
            let expected = irradiance * ((1.0 - alpha).powi(panes as i32) * 0.5 / std::f32::consts::PI);
            let mut checked = 0;
            for (pixel, record) in picture.visibility.iter().enumerate().filter(|(_, r)| r.depth > 0.0) {
                let found = Vec3::from(unpack_emission(record.emission)) / expected;
                assert_eq!(record.normal & SUN_VISIBLE, 0);
                // Fresnel's reflection on the rough floor is not in `expected`.
                assert!(
                    (0.97..1.06).contains(&found.x) && (0.96..1.07).contains(&found.z),
                    "{pixel}: {found}"
                );
                checked += 1;
            }
            let again = picture.samples.iter().filter(|s| s.depth > 0.0 && s.normal >> 25 != 0).count();
            assert!(checked > 1000 && again == 0, "{checked} {again}");
        }
        let open = picture_of(device, &floor_below(0, 0.5), &light);
        let lit = open.visibility.iter().filter(|r| r.depth > 0.0 && r.normal & SUN_VISIBLE != 0).count();
        let partly = open.samples.iter().filter(|s| s.depth > 0.0 && s.normal >> 25 != 0).count();
        assert!(lit > 1000 && partly == 0, "{lit} {partly}");
    });
}

/// So do samples with a lamp's, which each of them asks with one ray.
#[test]
fn panes_dim_lamps_alike_at_all_samples() {
    on_every_device(|device| {
        let dark = Environment::constant(Vec3::ZERO);
        let lit = |panes: u32, alpha: f32| {
            let mut scene = floor_below(panes, alpha);
            scene.lights.push(Light {
                kind: LightKind::Point,
                intensity: Vec3::splat(900.0),
                position: Vec3::new(0.0, 30.0, 0.0),
                direction: Vec3::NEG_Y,
                range: f32::INFINITY,
            });
            picture_of(device, &scene, &dark).samples
        };
        let open = lit(0, 0.5);
        for (panes, alpha) in [(1u32, 0.3f32), (2, 0.4), (4, 0.25)] {
            let share = (1.0 - alpha).powi(panes as i32);
            let (mut checked, dimmed) = (0, lit(panes, alpha));
            for (found, open) in dimmed.iter().zip(&open).filter(|(_, open)| open.depth > 0.0) {
                let found = found.first[1] / open.first[1];
                assert!((found - share).abs() < 2e-3, "{panes} of {alpha}: {found} for {share}");
                checked += 1;
            }
            assert!(checked > 1000, "{checked}");
        }
    });
}
