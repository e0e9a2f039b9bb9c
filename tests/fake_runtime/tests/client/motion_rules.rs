//! Motion vectors beside the views: right ones are taken, logged and written out, and each mistake is found.

use fake_runtime::script::{Dump, Script, Session};
use serde_json::{Value, json};

use crate::motion::DEPTHS;
use crate::{possible, run, run_and_listen, run_under_layers, validation};

/// A runtime that takes motion vectors.
fn script() -> Script {
    Script { motion_vectors: Some([24, 20]), ..Script::default() }
}

/// The mistakes that both structures allow, and what is said about them.
const MISTAKES: [(&str, &str); 14] = [
    ("vectors of depths", "xrEndFrame: motion vectors in a swapchain that is no colour attachment"),
    ("vectors not attached", "xrEndFrame: motion vectors in a swapchain that is no colour attachment"),
    ("depths of colours", "xrEndFrame: motion's depth in a swapchain of colours"),
    ("vectors outside", "xrEndFrame: Rect2Di { offset: Offset2Di { x: 1"),
    ("depths outside", "height: 21 } } is not inside 24 by 20"),
    ("never drawn", "xrEndFrame: a layer shows a swapchain of which no image was released"),
    ("near is far", "xrEndFrame: motion's depth between 0.1 and 0.1 metres"),
    ("far at the eye", "xrEndFrame: motion's depth between inf and 0 metres"),
    ("depth too far", "xrEndFrame: motion's depths from 0 to 2 are not between 0 and 1"),
    ("depth turned round", "xrEndFrame: motion's depths from 1 to 0 are not between 0 and 1"),
    ("delta of no length", "xrEndFrame: the pose's orientation has no length of 1"),
    ("delta to nowhere", "xrEndFrame: the pose's orientation has no length of 1"),
    ("unknown flags", "xrEndFrame: flags 0b1"),
    ("one view", "xrEndFrame: motion vectors beside some of a layer's views, not beside all"),
];

#[test]
fn right_motion_vectors_are_taken() {
    if !possible() {
        return;
    }
    for kind in ["synthesis", "space_warp", "both"] {
        let pictures = tempfile::tempdir().unwrap();
        let dump = Dump { frame: 4, folder: pictures.path().into() };
        let session = Session { dumps: vec![dump], ..Session::default() };
        let (log, said) = run_and_listen(kind, &Script { sessions: vec![session], ..script() });
        assert!(!said.contains("VUID"), "{said}");
        assert_eq!(log.violations(), Vec::<String>::new(), "{kind}");
        assert_eq!(log.leftovers(), Vec::<String>::new(), "{kind}");
        if validation::installed() {
            assert_eq!(run_under_layers(kind, &script()), Vec::<String>::new(), "{kind}");
        }
        let frame = &log.calls("xrEndFrame")[3].0;
        assert_eq!(frame["dumped"].as_array().unwrap().len(), 2 * 4, "{kind}");
        for (eye, words) in
            [[0x3400, 0xb800, 0x4000, 0x3c00], [0x3c00, 0xc000, 0, 0x3800u16]].iter().enumerate()
        {
            let view = &frame["layers"][0]["views"][eye];
            assert_eq!(view["depth"]["rect"], json!([0, 0, 24, 20]), "{kind}: {view}");
            check(&view["motion"], if kind == "both" { "synthesis" } else { kind });
            let read = |name: &str| std::fs::read(pictures.path().join(format!("{name}{eye}.raw"))).unwrap();
            let pixel: Vec<u8> = words.iter().flat_map(|half| half.to_le_bytes()).collect();
            assert_eq!(read("motion"), pixel.repeat(24 * 20), "{kind}, eye {eye}");
            assert_eq!(read("motion_depth"), DEPTHS[eye].to_le_bytes().repeat(24 * 20), "{kind}, eye {eye}");
        }
    }
}

/// What the log says of a view's motion vectors.
fn check(motion: &Value, kind: &str) {
    let mut expected = json!({
        "kind": kind, "flags": 1, "rect": [0, 0, 24, 20], "format": 97, "depth_rect": [0, 0, 24, 20],
        "delta": [0.0, 0.6f32, 0.0, 0.8f32, 0.5, 0.0, -1.0], "near_z": motion["near_z"], "far_z": 0.1f32,
        "min_depth": 0.0, "max_depth": 1.0,
        "swapchain": motion["swapchain"], "depth_swapchain": motion["depth_swapchain"],
    });
    if kind == "synthesis" {
        expected["flags"] = json!(3);
        expected["scale"] = json!([1.0, -1.0, 0.5, 1.0]);
        expected["offset"] = json!([0.25, 0.0, 0.0, 0.0]);
    }
    assert_eq!(*motion, expected);
    // The last digit of this one is lost where the log is read.
    assert_eq!(motion["near_z"].as_f64().unwrap() as f32, f32::MAX);
    assert!(motion["swapchain"].is_u64() && motion["swapchain"] != motion["depth_swapchain"], "{motion}");
}

#[test]
fn each_mistake_with_motion_vectors_is_found() {
    if !possible() {
        return;
    }
    let found = |mistake: &str, expected: &str| {
        let violations = run(mistake, &script()).violations();
        assert!(violations.iter().any(|v| v.contains(expected)), "{mistake}: {violations:?}");
    };
    for kind in ["synthesis", "space_warp"] {
        MISTAKES.iter().for_each(|(mistake, expected)| found(&format!("{kind} {mistake}"), expected));
    }
    found("synthesis not enabled", "xrEndFrame: XR_EXT_frame_synthesis is not enabled");
    found("synthesis endless scale", "xrEndFrame: scale and offset");
    found("synthesis offset of no number", "xrEndFrame: scale and offset");
    found(
        "synthesis not enabled",
        "xrEnumerateViewConfigurationViews: XR_EXT_frame_synthesis is not enabled",
    );
    found("space_warp not enabled", "xrEndFrame: XR_FB_space_warp is not enabled");
    found("space_warp not enabled", "xrGetSystemProperties: XR_FB_space_warp is not enabled");
    // Of two structures the second is looked at too.
    found("both near is far", "xrEndFrame: motion's depth between 0.1 and 0.1 metres");
}
