use super::*;
use crate::headset::mock::Profile;
use crate::math::pose::Pose;

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b}");
}

#[test]
fn the_inverse_undoes_the_distortion() {
    let optics = Optics::default();
    for i in 0..=25_000 {
        let r = f64::from(i) * 1e-4;
        close(optics.undistort(optics.distort(r)), r, 1e-12);
        close(optics.distort(optics.undistort(r)), r, 1e-12);
    }
    for wild in [f64::NAN, f64::NEG_INFINITY, -1.0] {
        assert_eq!(optics.undistort(wild), 0.0);
    }
    assert_eq!(optics.undistort(f64::INFINITY), 2.5);
}

#[test]
fn the_figures_of_libovr_are_met() {
    let optics = Optics::default();
    close(optics.centre_offset(Eye::Left), 0.151_976, 1e-6);
    close(optics.centre_offset(Eye::Right), -0.151_976, 1e-6);
    close(optics.scale(), 1.714_606, 1e-6);
    let fov = optics.field_of_view(Eye::Left);
    for (is, should) in [
        (fov.left, -1.803_682),
        (fov.right, 1.327_774),
        (fov.up, 1.957_160),
        (fov.down, -1.957_160),
        ((2.0 * fov.up.atan()).to_degrees(), 125.871),
    ] {
        close(is, should, 5e-4_f64.min(2e-6 * 10f64.powi(should.abs().log10() as i32 + 1)));
    }
    let profile = Profile::dk1();
    for (eye, expected) in Eye::BOTH.into_iter().zip([profile.fov_left, profile.fov_right]) {
        let fov = optics.field_of_view(eye);
        close(fov.left, expected.left, 2e-6);
        close(fov.right, expected.right, 2e-6);
    }
    assert_eq!(optics.picture_size(1.0), [1097, 1372]);
}

#[test]
fn the_pictures_edge_is_seen_at_the_panels_outer_edge() {
    let optics = Optics::default();
    let outer = optics.seen_at(Eye::Left, DVec2::new(0.0, 0.5), 1);
    close(outer.x, optics.field_of_view(Eye::Left).left, 1e-12);
    let outer = optics.seen_at(Eye::Right, DVec2::new(1.0, 0.5), 1);
    close(outer.x, optics.field_of_view(Eye::Right).right, 1e-12);
}

#[test]
fn points_of_the_panel_are_found_again_by_what_they_show() {
    let optics = Optics::default();
    for eye in Eye::BOTH {
        for (x, y) in (0..=20).flat_map(|y| (0..=20).map(move |x| (x, y))) {
            let point = DVec2::new(f64::from(x), f64::from(y)) / 20.0;
            let there = optics.shown_at(eye, optics.seen_at(eye, point, 1));
            assert!((there - point).length() < 1e-9, "{eye:?} {point}: {there}");
        }
    }
}

#[test]
fn straight_ahead_is_the_lens_centre_and_colours_part_outwards() {
    let optics = Optics::default();
    let centre = optics.shown_at(Eye::Left, DVec2::ZERO);
    close(centre.x, 0.5 + 0.5 * 0.151_976, 1e-6);
    close(centre.y, 0.5, 1e-12);
    for point in [DVec2::new(0.1, 0.2), DVec2::new(0.9, 0.9)] {
        let [red, green, blue] = [0, 1, 2].map(|c| optics.seen_at(Eye::Left, point, c).length());
        assert!(red < green && green < blue);
        let r = optics.offset_at(Eye::Left, point).length();
        close(red / green, 0.996 - 0.004 * r * r, 1e-12);
        close(blue / green, 1.014, 1e-12);
    }
}

#[test]
fn a_warp_is_the_same_as_the_lens_model() {
    let optics = Optics::default();
    let (picture, window) = ([700, 870], [1280, 800]);
    for (eye, warp) in Eye::BOTH.into_iter().zip(optics.warps(picture, window)) {
        let view = View {
            world_from_eye: Pose::IDENTITY,
            fov: optics.field_of_view(eye),
            width: picture[0],
            height: picture[1],
            spacing: Default::default(),
        };
        for pixel in [DVec2::new(12.5, 700.5), DVec2::new(320.5, 400.5), DVec2::new(600.5, 3.5)] {
            let at = pixel + DVec2::X * f64::from(warp.target[0]);
            let point = pixel / DVec2::new(640.0, 800.0);
            for colour in 0..3 {
                let tangents = optics.seen_at(eye, point, colour);
                let expected = view.project(tangents.extend(-1.0)).unwrap();
                let is = warp.source_of(at, colour);
                assert!((is - expected).length() < 1e-9, "{eye:?} {pixel} {colour}: {is} {expected}");
            }
        }
    }
}

#[test]
fn a_device_is_believed_where_it_can_be() {
    let factory = DisplayInfo {
        command_id: 0,
        distortion_type: 1,
        resolution: [1280, 800],
        size: [149_760, 93_600],
        vertical_centre: 46_800,
        lens_separation: 63_500,
        lens_distance: [49_800, 49_800],
        distortion: [0.0; 6],
    };
    let known = Optics::default();
    let of = Optics::of_device(&factory);
    close(of.scale(), known.scale(), 1e-9);
    assert_eq!((of.pixels, of.coefficients), (known.pixels, known.coefficients));
    let other = DisplayInfo { lens_separation: 60_000, resolution: [1920, 1080], ..factory };
    close(Optics::of_device(&other).centre_offset(Eye::Left), 1.0 - 120.0 / 149.76, 1e-9);
    assert_eq!(Optics::of_device(&other).pixels, [1920, 1080]);
    let own = DisplayInfo { distortion_type: 2, distortion: [1.0, 0.18, 0.115, 0.0, 0.0, 0.0], ..factory };
    assert_eq!(Optics::of_device(&own).coefficients[1], f64::from(0.18f32));
    for nonsense in [
        DisplayInfo { distortion_type: 0, lens_separation: 60_000, ..factory },
        DisplayInfo { lens_separation: u32::MAX, ..factory },
        DisplayInfo { size: [0, 0], ..factory },
        DisplayInfo { resolution: [0, u16::MAX], ..factory },
        DisplayInfo { distortion_type: 2, ..factory },
        DisplayInfo { distortion_type: 2, distortion: [1.0, -0.5, 0.0, 0.0, 0.0, 0.0], ..factory },
        DisplayInfo { distortion_type: 2, distortion: [f32::MAX; 6], ..factory },
        DisplayInfo { distortion_type: 2, distortion: [0.77, 0.0, 0.0, 1.1e36, -2e38, 1.8e38], ..factory },
        DisplayInfo { distortion_type: 2, distortion: [1.0, 0.0, 0.0, 2.0, 0.0, 0.0], ..factory },
        DisplayInfo { distortion_type: 3, distortion: [1.0, 0.18, 0.115, 0.0, 0.0, 0.0], ..factory },
    ] {
        close(Optics::of_device(&nonsense).scale(), known.scale(), 1e-9);
    }
    assert!(!Optics::distrusts(&factory) && !Optics::distrusts(&own));
    let unbounded =
        DisplayInfo { distortion_type: 2, distortion: [0.77, 0.0, 0.0, 1.1e36, 0.0, 0.0], ..factory };
    assert!(Optics::distrusts(&unbounded));
    // No picture is larger than a device can make, whatever a tracker says.
    let most = Optics::of_device(&unbounded).picture_size(1.0);
    assert!(most[0] < 2000 && most[1] < 2000, "{most:?}");
}
