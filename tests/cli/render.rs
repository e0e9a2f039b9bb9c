//! `foveate render`: each flag does what it says.

use foveate::metrics::{Display, Picture};

use super::*;

/// Renders the small picture with more flags, and returns it and what was told about it.
fn picture(folder: &Path, flags: &str) -> (RgbImage, Value) {
    let told = foveate(folder, &format!("{SMALL} --out it.png {flags}")).succeeds().json();
    (png(folder.join("it.png")), told)
}

fn exr(folder: &Path, flags: &str) -> Picture {
    foveate(folder, &format!("{SMALL} --out it.exr {flags}")).succeeds();
    let picture = Picture::read_exr(&folder.join("it.exr")).unwrap();
    assert_eq!(picture.not_finite(), 0, "{flags}");
    picture
}

#[test]
fn the_json_object_has_the_keys_that_others_build_on() {
    let folder = folder();
    let (picture, told) = picture(folder.path(), "");
    assert_eq!(picture.dimensions(), (48, 32));
    assert_eq!([&told["width"], &told["height"], &told["pixels"], &told["samples"]], [48, 32, 1536, 300]);
    assert!(told["rays"].as_u64().unwrap() >= 300);
    for (key, parts) in [
        ("frame_ms", &["p50", "p99"][..]),
        ("stage_ms", &["motion", "trace", "shade", "light", "share", "reconstruct"]),
    ] {
        assert_eq!(told[key].as_object().unwrap().len(), parts.len());
        assert!(parts.iter().all(|part| told[key][part].as_f64().unwrap() >= 0.0), "{told}");
    }
    assert!(told["frame_ms"]["p50"].as_f64().unwrap() > 0.0);
    assert!(!told["device"].as_str().unwrap().is_empty());
    assert!(["zero-copy", "staged"].contains(&told["sharing"].as_str().unwrap()));
    let start = told["start_ms"].as_object().unwrap();
    assert!(["scene", "bvh", "environment", "first_picture"].iter().all(|step| start[*step].is_number()));
    let text = foveate(folder.path(), &format!("{} --out it.png", SMALL.replace("--json ", ""))).succeeds();
    assert!(text.out.contains("48x32, 300 samples for 1536 pixels, 4 rays each"), "{text:?}");
    assert_eq!(names(folder.path()), ["it.png", "scene.glb"], "nothing else is left behind");
}

#[test]
fn the_same_seed_gives_the_same_file_and_another_another() {
    let folder = folder();
    let file = |name: &str, flags: &str| {
        foveate(folder.path(), &format!("{SMALL} --out {name} {flags}")).succeeds();
        std::fs::read(folder.path().join(name)).unwrap()
    };
    for guided in ["", "--reconstruct guided"] {
        let first = file("a.png", &format!("--seed 7 {guided}"));
        assert_eq!(first, file("b.png", &format!("--seed 7 {guided}")));
        assert_ne!(first, file("b.png", &format!("--seed 4294967295 {guided}")));
    }
    assert_eq!(file("a.exr", "--seed 7"), file("b.exr", "--seed 7"));
}

/// No pixel depends on which thread does what. The demo scene has corners where no cell of the cache of light is small enough.
#[test]
fn the_demo_scene_is_the_same_in_each_run() {
    let folder = folder();
    foveate(folder.path(), "scene generate demo --out demo.glb").succeeds();
    for (traversal, runs) in [("packet", 2), ("single-ray", 5)] {
        let flags = format!(
            "render demo.glb --width 320 --height 200 --set trace.traversal={traversal} --out it.png"
        );
        let file = || {
            foveate(folder.path(), &flags).succeeds();
            std::fs::read(folder.path().join("it.png")).unwrap()
        };
        let first = file();
        assert!((1..runs).all(|_| file() == first), "{traversal} differs from run to run");
    }
}

#[test]
fn every_flag_changes_the_picture() {
    let folder = folder();
    let sky = Picture::new(8, 4, vec![[0.3, 0.5, 4.0]; 32]).unwrap();
    sky.write_exr(&folder.path().join("blue.exr")).unwrap();
    let (base, told) = picture(folder.path(), "");
    let rays = told["rays"].as_u64().unwrap();
    // The flags, what is told of the samples, and by how much at least the rays grow.
    for (flags, samples, growth) in [
        ("--environment blue.exr", 300, 0.0),
        ("--position=-3,2,4", 300, 0.0),
        ("--look-at -1,0.5,0", 300, 0.0),
        ("--fov-y 20", 300, 0.0),
        ("--fov-y 1", 300, 0.0),
        ("--fov-y 175", 300, 0.0),
        ("--law uniform", 300, 0.0),
        ("--law linear-mar", 300, 0.0),
        ("--law log-polar", 300, 0.0),
        ("--law full", 1536, 2.0),
        ("--samples full", 1536, 2.0),
        ("--samples 1536", 1536, 2.0),
        ("--samples 1", 1, 0.0),
        ("--samples 4 --k 16", 4, 0.0),
        ("--reconstruct guided", 300, 1.0),
        ("--rays 1", 300, 0.0),
        ("--rays 16", 300, 2.0),
        ("--rays 33", 300, 4.0),
        ("--bounces 1", 300, 1.05),
        ("--bounces 4", 300, 1.1),
        ("--k 1", 300, 0.0),
        ("--k 16", 300, 0.0),
        ("--gaze 0,0", 300, 0.0),
        ("--gaze 1,1", 300, 0.0),
        ("--gaze=-3,1e300", 300, 0.0),
        ("--exposure=-1.5", 300, 1.0),
        ("--passes 3", 300, 1.0),
        ("--set reconstruction.weights=gaussian", 300, 1.0),
        ("--set environment.sun_azimuth=200", 300, 0.0),
    ] {
        let (changed, told) = picture(folder.path(), flags);
        assert!(differing(&base, &changed) > 40, "{flags} changes nothing");
        assert_eq!(told["samples"], samples, "{flags}");
        assert!(told["rays"].as_f64().unwrap() >= 0.98 * growth * rays as f64, "{flags}: {told}");
    }
}

/// A sample at each pixel is shown as it is: records' steps and averages are for fewer, or for those who ask.
#[test]
fn all_samples_are_shown_as_they_are_unless_a_reconstruction_is_asked_for() {
    let folder = folder();
    let with = |flags: &str| {
        let small = SMALL.replace(" --samples 300", "").replace(" --reconstruct k-nn", "");
        foveate(folder.path(), &format!("{small} --out it.png --samples full {flags}")).succeeds();
        png(folder.path().join("it.png"))
    };
    let plain = with("");
    assert_eq!(differing(&plain, &with("--reconstruct k-nn --k 1")), 0);
    for asked in ["--reconstruct guided", "--set reconstruction.method='guided'", "--k 4"] {
        assert!(differing(&plain, &with(asked)) > 100, "{asked}");
    }
}

#[test]
fn settings_come_from_files_then_assignments_then_flags() {
    let folder = folder();
    let settings = "[trace]\nseed = 5\nbounces = 3\n[foveation]\nlaw = 'uniform'\n[devices]\nopencl = '0'\n";
    std::fs::write(folder.path().join("a.toml"), settings).unwrap();
    std::fs::write(folder.path().join("b.toml"), "trace.bounces = 2").unwrap();
    let layered = picture(folder.path(), "--config a.toml --config b.toml --set trace.bounces=1").0;
    let flags = picture(folder.path(), "--seed 5 --bounces 1 --law uniform --device 0").0;
    assert_eq!(differing(&layered, &flags), 0);
    // Flags win.
    let over = picture(folder.path(), "--config a.toml --seed 0 --bounces 0 --law paper").0;
    assert_eq!(differing(&over, &picture(folder.path(), "").0), 0);
    assert!(differing(&over, &flags) > 100);
}

#[test]
fn exr_is_linear_and_png_is_what_a_screen_shows_of_it() {
    let folder = folder();
    let linear = exr(folder.path(), "");
    assert!(linear.pixels.iter().flatten().any(|&c| c > 1.0), "a lamp or the sky is brighter than white");
    for exposure in [0.0, 1.5, -2.0] {
        let shown = picture(folder.path(), &format!("--exposure={exposure}")).0;
        let expected = Display::from_picture(&linear, exposure as f32);
        for (is, should) in shown.pixels().zip(&expected.pixels) {
            for (is, should) in is.0.iter().zip(should) {
                assert!((f32::from(*is) - should * 255.0).abs() <= 1.5, "{exposure}: {is} for {should}");
            }
        }
    }
    assert_eq!(exr(folder.path(), "--exposure 3"), linear, "linear radiance knows no exposure");
    // Averaged pictures are displayed by the same formula on another path.
    let shown = picture(folder.path(), "--passes 2 --exposure 1").0;
    let expected = Display::from_picture(&exr(folder.path(), "--passes 2"), 1.0);
    let byte = |c: f32| (c * 255.0).round() as u8;
    assert!(shown.pixels().zip(&expected.pixels).all(|(is, should)| is.0 == should.map(byte)));
}

#[test]
fn environment_maps_of_both_kinds_light_the_scene() {
    let folder = folder();
    let sky = picture(folder.path(), "").0;
    for map in ["hdri/venice.hdr", "hdri/forest.exr"] {
        let Some(path) = common::data(map) else { continue };
        let flags = format!("--environment {} --out it.png", path.display());
        let run = foveate(folder.path(), &format!("{SMALL} {flags}"));
        // One of them has negative texels, which is told.
        assert!(run.code == Some(0) && run.err.lines().all(|l| l.starts_with("foveate: note: ")), "{run:?}");
        assert!(differing(&sky, &png(folder.path().join("it.png"))) > 700, "{map}");
    }
}

#[test]
fn shared_stereo_shows_both_eyes_one_view_and_per_eye_two() {
    let folder = folder();
    let halves = |stereo: &str| {
        let flags = format!("--stereo {stereo} --position 0.2,0.8,3 --set view.ipd=0.2 --samples 300");
        let (both, told) = picture(folder.path(), &flags);
        let half = |x| image::imageops::crop_imm(&both, x, 0, 24, 32).to_image();
        (half(0), half(24), told["samples"].as_u64().unwrap())
    };
    let (left, right, samples) = halves("shared");
    assert_eq!((differing(&left, &right), samples), (0, 300));
    let (left, right, samples) = halves("per-eye");
    assert!(differing(&left, &right) > 200);
    assert_eq!(samples, 600);
    assert!(differing(&halves("mono").0, &left) > 200);
}

#[test]
fn pictures_of_any_size_have_it() {
    let folder = folder();
    // A picture of one pixel may be white.
    let view =
        "render scene.glb --json --rays 2 --position 0.2,1.5,5 --look-at 0,0.9,0 --out it.png --exposure=-1";
    for (flags, size, samples) in [
        ("--width 1 --height 1", (1, 1), 1),
        ("--width 1 --height 1 --samples full --k 16 --reconstruct k-nn", (1, 1), 1),
        ("--width 97 --height 3 --samples 200", (97, 3), 200),
        ("--width 2 --height 501 --stereo per-eye --samples 17 --k 16", (2, 501), 34),
        ("--width 4096 --height 1 --samples 5 --fov-y 175", (4096, 1), 5),
        // The usual share of the pixels.
        ("--width 33 --height 17", (33, 17), 30),
    ] {
        let told = foveate(folder.path(), &format!("{view} {flags}")).succeeds().json();
        assert_eq!(png(folder.path().join("it.png")).dimensions(), size, "{flags}");
        assert_eq!(told["samples"], samples, "{flags}");
    }
}

#[test]
fn extreme_points_of_view_make_pictures_of_finite_numbers() {
    let folder = folder();
    for flags in [
        "--position 0,1,0 --look-at 0,9,0",
        "--position 0,1,0 --look-at 0,-9,0",
        "--position 1e300,0,0",
        "--position 0,0,0 --look-at 1e308,-1e308,0",
        "--position 1,1,1 --look-at 1,1,1.0000000000000002",
        "--samples 1 --reconstruct guided --gaze 1e300,-1e300",
    ] {
        exr(folder.path(), flags);
    }
}

fn mean_code(picture: &RgbImage) -> f64 {
    let sum: f64 = picture.pixels().flat_map(|p| p.0).map(f64::from).sum();
    sum / f64::from(picture.width() * picture.height() * 3)
}

/// A folder whose `scene.glb` has lights as Blender exports them: a sun of 5 W/m² is 683 lm/W as many lux, a lamp
/// of 1000 W 683 / 4π as many candela.
fn folder_from_blender() -> tempfile::TempDir {
    let folder = folder();
    let mut builder = Builder::new();
    let corners = [[-4.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, -4.0], [-4.0, 0.0, -4.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let grey = json!({ "baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0 });
    let material = builder.push("materials", json!({ "pbrMetallicRoughness": grey }));
    let primitive =
        json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
    builder.place(primitive, json!({}));
    let lamp = 1000.0 * 683.0 / (4.0 * std::f64::consts::PI);
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "directional", "intensity": 5.0 * 683.0 }, { "type": "point", "intensity": lamp }
    ] } });
    builder.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let down = json!([-0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()]);
    for (light, place) in [(0, json!({ "rotation": down })), (1, json!({ "translation": [1, 2.5, 0] }))] {
        let mut node = place;
        node["extensions"] = json!({ "KHR_lights_punctual": { "light": light } });
        let node = builder.push("nodes", node);
        builder.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    }
    builder.write_glb(folder.path());
    folder
}

#[test]
fn automatic_exposure_shows_any_light_in_the_middle_of_the_range() {
    let (plain, blender) = (folder(), folder_from_blender());
    for reconstruct in ["k-nn", "guided"] {
        for (folder, flags) in [
            (&plain, "--set environment.exposure=0"),
            (&plain, "--set environment.exposure=12"),
            (&plain, "--set environment.exposure=-2"),
            (&blender, "--look-at 0,0,0"),
        ] {
            let shown = |exposure: &str| {
                let flags = format!("{flags} --reconstruct {reconstruct} --exposure {exposure}");
                mean_code(&picture(folder.path(), &flags).0)
            };
            let (auto, passes) = (shown("auto"), shown("auto --passes 2"));
            println!("{reconstruct} {flags}: mean code {auto} at once, {passes} of two passes");
            assert!((60.0..185.0).contains(&auto), "{flags}: {auto}");
            assert!(
                (auto - passes).abs() < 45.0,
                "{flags}: {auto} at once, {passes} by the finished picture"
            );
            let held = shown("auto --set view.exposure_range=[-30,-29]");
            assert!(held < 5.0 || flags.contains("=12"), "{flags}: {held} beyond the limit");
        }
    }
    let noted = |folder: &Path, flags: &str| {
        let run = foveate(folder, &format!("{SMALL} --out it.png {flags}"));
        assert_eq!(run.code, Some(0), "{run:?}");
        run.err.contains("nearly white; --exposure auto")
    };
    for flags in ["--look-at 0,0,0", "--look-at 0,0,0 --passes 2"] {
        assert!(noted(blender.path(), flags), "{flags}");
        let white = mean_code(&png(blender.path().join("it.png")));
        assert!(white > 170.0, "without it a sun of 3415 lux is white: {white}");
    }
    assert!(!noted(blender.path(), "--look-at 0,0,0 --exposure auto") && !noted(plain.path(), ""));
}
