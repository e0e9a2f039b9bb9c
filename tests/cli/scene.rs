//! `foveate scene`.

use super::*;

#[test]
fn a_generated_town_has_the_size_that_was_asked_for_and_renders() {
    let folder = tempfile::tempdir().unwrap();
    let generate = "scene generate voxel-town --triangles 12000";
    let told = foveate(folder.path(), &format!("{generate} --out a.glb --json")).succeeds().json();
    let bytes = std::fs::read(folder.path().join("a.glb")).unwrap();
    assert_eq!((&told["out"], &told["bytes"]), (&json!("a.glb"), &json!(bytes.len())));
    foveate(folder.path(), &format!("{generate} --out b.glb")).succeeds();
    assert!(bytes == std::fs::read(folder.path().join("b.glb")).unwrap(), "the same again");
    foveate(folder.path(), &format!("{generate} --seed 2 --out b.glb")).succeeds();
    assert!(bytes != std::fs::read(folder.path().join("b.glb")).unwrap(), "another seed, another town");

    let info = foveate(folder.path(), "scene info a.glb --json").succeeds().json();
    assert!((11_880..=12_120).contains(&info["triangles"].as_u64().unwrap()), "{info}");
    for key in ["instances", "materials", "textures"] {
        assert!(info[key].as_u64().unwrap() > 0, "{key} of {info}");
    }
    assert!(info["bounds"]["min"][0].as_f64() < info["bounds"]["max"][0].as_f64());
    assert_eq!(
        (&info["features"]["textures"], &info["features"]["vertex_colors"]),
        (&json!(true), &json!(false))
    );
    let buffers = info["device_buffers"].as_array().unwrap();
    let sum: u64 = buffers.iter().map(|buffer| buffer["bytes"].as_u64().unwrap()).sum();
    assert!(buffers.len() > 5 && info["device_bytes"] == sum, "{info}");

    let text = foveate(folder.path(), "scene info a.glb").succeeds().out;
    for part in ["triangles", "materials", "bounds", "features    textures", "texels", "MiB", "viewer"] {
        assert!(text.contains(part) && !text.contains('{'), "{part}: {text}");
    }
    foveate(folder.path(), "render a.glb --out a.png --width 64 --height 48 --rays 4").succeeds();
    assert_eq!(png(folder.path().join("a.png")).dimensions(), (64, 48));
}

/// What a town's OBJ shows is what its binary glTF shows, and both are written again over themselves.
#[test]
fn a_generated_town_is_written_as_obj_too() {
    let folder = tempfile::tempdir().unwrap();
    let triangles = |file: &str| {
        for _ in 0..2 {
            let line = format!("scene generate voxel-town --triangles 12000 --out {file}");
            foveate(folder.path(), &line).succeeds();
        }
        foveate(folder.path(), &format!("scene info {file} --json")).succeeds().json()["triangles"].clone()
    };
    assert_eq!(triangles("town.obj"), triangles("town.glb"));
    assert!(folder.path().join("town.mtl").is_file());
}

#[test]
fn a_generated_glade_has_the_size_that_was_asked_for_and_the_demo_takes_none() {
    let folder = tempfile::tempdir().unwrap();
    let generate = "scene generate organic --triangles 150000 --out a.glb";
    foveate(folder.path(), generate).succeeds();
    let info = foveate(folder.path(), "scene info a.glb --json").succeeds().json();
    assert!((148_500..=151_500).contains(&info["triangles"].as_u64().unwrap()), "{info}");
    assert_eq!(info["warnings"], json!([]), "{info}");
    let run = foveate(folder.path(), "scene generate organic --triangles 1000 --out b.glb");
    assert!(run.sentence().contains("--triangles: 1000 is not within"), "{run:?}");
    let run = foveate(folder.path(), "scene generate demo --triangles 20000 --out b.glb");
    assert!(run.sentence().contains("fixed number"), "{run:?}");
    assert_eq!(names(folder.path()), ["a.glb"]);
}

#[test]
fn features_that_a_scene_does_not_use_cost_nothing() {
    let folder = folder();
    let info = foveate(folder.path(), "scene info scene.glb --json").succeeds().json();
    assert_eq!([&info["triangles"], &info["instances"], &info["materials"], &info["textures"]], [8, 4, 4, 0]);
    assert_eq!((&info["features"]["textures"], &info["features"]["sun"]), (&json!(false), &json!(true)));
    let names: Vec<&str> =
        info["device_buffers"].as_array().unwrap().iter().map(|b| b["name"].as_str().unwrap()).collect();
    assert!(!names.contains(&"texels") && !names.contains(&"colors"), "{names:?}");
    assert!((info["bounds"]["max"][1].as_f64().unwrap() - 2.0).abs() < 1e-6, "{info}");
}

#[test]
fn towns_of_impossible_sizes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for triangles in ["0", "9999", "20000001", "18446744073709551615"] {
        let run =
            foveate(folder.path(), &format!("scene generate voxel-town --triangles {triangles} --out a.glb"));
        assert!(run.sentence().contains(&format!("--triangles: {triangles} is not within")), "{run:?}");
    }
    assert!(names(folder.path()).is_empty());
}
