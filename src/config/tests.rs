use std::path::Path;

use toml::{Table, Value};

use super::layers::RENAMED;
use super::*;
use crate::foveation::Law;

#[test]
fn the_commented_file_is_the_default() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/default.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let table: Table = text.parse().unwrap();
    assert_eq!(table, Table::try_from(Config::default()).unwrap());
}

#[test]
fn old_keys_are_answered_by_the_new_ones() {
    for (old, _) in RENAMED {
        let told = Layers::default().assign(&format!("{old}=alone")).unwrap_err().to_string();
        assert!(told.contains(old) && told.contains("trace.traversal"), "{told}");
        assert!(!Layers::default().gives(old));
    }
    let mut layers = Layers::default();
    layers.assign("trace.traversal=single-ray").unwrap();
    assert_eq!(layers.finish().unwrap().trace.traversal, TraversalConfig::SingleRay);
}

#[test]
fn later_layers_win() {
    let mut layers = Layers::default();
    layers.assign("trace.rays=16").unwrap();
    layers.assign("foveation.samples=full").unwrap();
    layers.assign("foveation.law=uniform").unwrap();
    layers.assign("trace.rays=8").unwrap();
    let config = layers.finish().unwrap();
    assert_eq!(config.trace.rays, 8);
    assert_eq!(config.foveation.samples, Samples::Full);
    assert_eq!(config.foveation.law, Law::Uniform);
}

#[test]
fn parameters_of_a_law_can_be_set_alone() {
    let mut layers = Layers::default();
    layers.assign("foveation.law.exponent=-1.5").unwrap();
    let Law::Paper { exponent, .. } = layers.finish().unwrap().foveation.law else { panic!() };
    assert_eq!(exponent, -1.5);
}

#[test]
fn wrong_settings_are_refused_by_name() {
    for (assignment, part) in [
        ("trace.rays", "not key=value"),
        ("trace.rayz=3", "rayz"),
        ("trace.rays=0", "trace.rays"),
        ("trace.rays=many", "trace.rays"),
        ("view.fov_y=180", "view.fov_y"),
        ("foveation.law=spiral", "spiral"),
        ("foveation.samples=0", "samples"),
        ("", "not key=value"),
        ("=3", "configs/default.toml"),
        ("view=3", "view"),
        ("a.b.c.d.e.f.g.h.i=3", "so many dots"),
        ("trace.rays=16\nview.width=8", "trace.rays"),
        ("view.exposure=nan", "out of range"),
        ("view.exposure=bright", "\"auto\""),
        ("view.exposure_range=[2, 1]", "exposure_range"),
        ("foveation.samples=1024001", "more than the 1024000 pixels"),
    ] {
        let mut layers = Layers::default();
        let result = layers.assign(assignment).and_then(|()| layers.finish());
        let message = result.expect_err(assignment).to_string();
        assert!(message.contains(part), "{assignment}: {message}");
    }
}

#[test]
fn the_default_number_of_samples_fits_any_picture_and_a_given_one_must_fit() {
    let mut layers = Layers::default();
    layers.assign("view.width=96").unwrap();
    layers.assign("view.height=64").unwrap();
    assert!(
        !layers.gives("foveation.samples") && layers.gives("view.width") && !layers.gives("view.no.such")
    );
    layers.finish().unwrap();
    layers.assign("foveation.samples=6144").unwrap();
    layers.finish().unwrap();
    layers.assign("view.stereo=per-eye").unwrap();
    assert!(layers.finish().unwrap_err().to_string().contains("3072 pixels of each eye"));
}

#[test]
fn fronts_give_what_is_traded_and_nothing_else() {
    let point = OperatingPoint {
        frame_ms: 1.0,
        score: 1.0,
        samples: 0.5,
        rays: 3,
        bounces: 3,
        edge_rays: 3,
        method: Method::KNearest,
        k: 3,
        weights: WeightsConfig::Inverse,
        law: Law::Uniform,
    };
    let tables =
        [Config::default(), point.quality(Quality::of(&Config::default())).applied_to(&Config::default())];
    let [before, after] = tables.map(|config| Table::try_from(config).unwrap());
    for (section, values) in &before {
        for (key, value) in values.as_table().unwrap() {
            let name = format!("{section}.{key}");
            assert_eq!(*value != after[section][key], TRADED.contains(&name.as_str()), "{name}");
        }
    }
}

#[test]
fn frames_keep_up_with_a_display_unless_settings_say_otherwise() {
    let mut none = Config::default();
    none.budget.target_ms = TargetMs::None;
    let keeping_up = |assignments: &[&str]| {
        let mut layers = Layers::over(none.clone());
        assignments.iter().for_each(|assignment| layers.assign(assignment).unwrap());
        let fixed = layers.keep_up();
        (layers.finish().unwrap().budget.target_ms, fixed)
    };
    assert_eq!(keeping_up(&[]), (TargetMs::Display, None));
    assert_eq!(keeping_up(&["trace.seed=3", "view.width=640"]), (TargetMs::Display, None));
    assert_eq!(keeping_up(&["budget.target_score=7"]), (TargetMs::Display, None));
    assert_eq!(keeping_up(&["trace.rays=32"]), (TargetMs::None, Some("trace.rays")));
    assert_eq!(keeping_up(&["foveation.law=uniform"]), (TargetMs::None, Some("foveation.law")));
    assert_eq!(keeping_up(&["foveation.law.exponent=-1"]), (TargetMs::None, Some("foveation.law")));
    assert_eq!(keeping_up(&["trace.rays=32", "budget.target_ms=20"]), (TargetMs::Ms(20.0), None));
    assert_eq!(keeping_up(&["budget.target_ms=none"]), (TargetMs::None, None));
    for name in preset::names() {
        let mut layers = Layers::over(none.clone());
        layers.preset(name).unwrap();
        assert_eq!(layers.keep_up(), Some("foveation.law"), "a preset's settings are settings");
    }
}

#[test]
fn displays_expose_by_what_is_seen_unless_stops_are_given() {
    let exposing = |assignments: &[&str]| {
        let mut layers = Layers::default();
        assignments.iter().for_each(|assignment| layers.assign(assignment).unwrap());
        layers.expose();
        layers.finish().unwrap().view.exposure
    };
    assert_eq!(exposing(&["view.width=640"]), ExposureConfig::Auto);
    assert_eq!(exposing(&["view.exposure=0"]), ExposureConfig::Stops(0.0));
    assert_eq!(exposing(&["view.exposure=auto"]), ExposureConfig::Auto);
    assert_eq!(Layers::default().finish().unwrap().view.exposure, ExposureConfig::Stops(0.0));
}

#[test]
fn large_pictures_are_refused_before_they_are_allocated() {
    let mut layers = Layers::default();
    layers.assign("view.width=16384").unwrap();
    layers.assign("view.height=2048").unwrap();
    layers.finish().unwrap();
    layers.assign("view.height=2049").unwrap();
    assert!(layers.finish().unwrap_err().to_string().contains("more than"));
}

#[test]
fn files_are_refused_by_their_name_and_the_keys() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    for (text, part) in [
        ("trace = {", "not a TOML file"),
        ("[trace]\nrays = 'many'", "trace.rays: "),
        ("[trace]\nrayz = 3", "rayz"),
        ("[view]\nfov_y = 180.0", "view.fov_y: 180 is out of range"),
        ("[tracer]", "tracer"),
        ("view = 3", "view"),
        ("[foveation]\nlaw = 'spiral'", "spiral"),
    ] {
        std::fs::write(&path, text).unwrap();
        let message = Layers::default().file(&path).expect_err(text).to_string();
        assert!(message.starts_with(path.to_str().unwrap()) && message.contains(part), "{text}: {message}");
    }
    std::fs::write(&path, [0xff, 0xfe]).unwrap();
    assert!(Layers::default().file(&path).unwrap_err().to_string().contains("UTF-8"));
    std::fs::write(&path, "#".repeat(1 << 21)).unwrap();
    assert!(Layers::default().file(&path).unwrap_err().to_string().contains("1 MiB"));
    assert!(Layers::default().file(folder.path()).unwrap_err().to_string().contains("not a regular file"));
}

#[test]
fn a_files_values_and_its_law_are_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    // More samples than the default picture has pixels: the size may still come.
    let text = "[foveation]\nsamples = 2000000\n[foveation.law]\nname = 'log-polar'\nalpha = 2.0";
    std::fs::write(&path, text).unwrap();
    let mut layers = Layers::default();
    layers.file(&path).unwrap();
    assert!(layers.finish().is_err());
    layers.assign("view.width=4096").unwrap();
    let config = layers.finish().unwrap();
    assert_eq!(
        config.foveation,
        FoveationConfig {
            law: Law::LogPolar { alpha: 2.0 },
            samples: Samples::Count(2_000_000),
            visibility_slope: 0.011
        }
    );
}

#[test]
fn values_of_wrong_types_are_told_in_words_of_toml() {
    fn keys(table: &Table, prefix: &str, found: &mut Vec<String>) {
        for (key, value) in table {
            let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            match value {
                Value::Table(section) => keys(section, &key, found),
                _ => found.push(key),
            }
        }
    }
    let mut found = Vec::new();
    keys(&Table::try_from(Config::default()).unwrap(), "", &mut found);
    assert!(found.len() > 20, "{found:?}");
    let mut refused = 0;
    for key in &found {
        for value in ["'x?y'", "-3", "1.5", "[1, 2]", "true", "{ a = 1 }"] {
            let Err(error) = Layers::default().assign(&format!("{key}={value}")) else { continue };
            let message = error.to_string();
            refused += 1;
            for word in message.replace(key, "").split(|c: char| !c.is_ascii_alphanumeric()) {
                let rust = [
                    "u8", "u32", "u64", "usize", "i64", "f32", "f64", "bool", "struct", "enum", "sequence",
                    "map", "untagged", "newtype", "tuple", "unit",
                ];
                assert!(!rust.contains(&word), "{key}={value}: {message}");
            }
        }
    }
    assert!(refused > 60, "{refused}");
}
