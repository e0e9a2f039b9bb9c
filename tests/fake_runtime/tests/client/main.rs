//! The runtime under a small application: a correct one passes, and each planted mistake is found.

mod application;
mod motion;
mod motion_rules;
#[path = "../../../common/validation.rs"]
mod validation;
mod vulkan;

use std::process::Command;

use fake_runtime::Setup;
use fake_runtime::log::Log;
use fake_runtime::script::{Dump, Script, Session};

/// Tells the application, which runs in a process of its own, its mistake.
const MISTAKE: &str = "FAKE_XR_MISTAKE";

/// The application itself. The loader holds one runtime for each process, so each run is a process.
#[test]
#[ignore = "run by the tests below, each in a process of its own"]
fn client() {
    if let Ok(mistake) = std::env::var(MISTAKE) {
        application::run(&mistake);
    }
}

/// Whether loader and Vulkan are there; says so where they are not. On machines that promise them
/// (CI=true) that is a failure.
fn possible() -> bool {
    let missing = application::missing();
    if let Some(missing) = &missing {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "{missing}");
        println!("not run: {missing}");
    }
    missing.is_none()
}

/// What the application called with one mistake, or none.
fn run(mistake: &str, script: &Script) -> Log {
    run_and_listen(mistake, script).0
}

/// The same, and what Vulkan's validation layer, where it is installed, has said.
fn run_and_listen(mistake: &str, script: &Script) -> (Log, String) {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup::new(folder.path(), script);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "client", "--ignored", "--nocapture"]).env(MISTAKE, mistake);
    command.env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
    let output = setup.apply(&mut command).output().unwrap();
    let text =
        String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{mistake}: {text}");
    (setup.log(), text)
}

/// What Khronos' layers say of the application with a mistake.
fn run_under_layers(mistake: &str, script: &Script) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup::new(folder.path(), script);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "client", "--ignored", "--nocapture"]).env(MISTAKE, mistake);
    let output = setup.apply(&mut command).envs(validation::environment(folder.path())).output().unwrap();
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    validation::messages(folder.path(), &text.concat())
}

#[test]
fn a_correct_application_breaks_no_rule() {
    if !possible() {
        return;
    }
    let pictures = tempfile::tempdir().unwrap();
    let dump = Dump { frame: 4, folder: pictures.path().into() };
    let session = Session { dumps: vec![dump], ..Session::default() };
    let (log, said) = run_and_listen("", &Script { sessions: vec![session], ..Script::default() });
    assert!(!said.contains("VUID"), "{said}");
    assert_eq!(log.violations(), Vec::<String>::new());
    assert_eq!(log.leftovers(), Vec::<String>::new());
    let states: Vec<&str> = log.calls("xrPollEvent").iter().filter_map(|r| r.0["state"].as_str()).collect();
    let expected = [
        "IDLE",
        "READY",
        "SYNCHRONIZED",
        "VISIBLE",
        "FOCUSED",
        "VISIBLE",
        "SYNCHRONIZED",
        "STOPPING",
        "IDLE",
        "EXITING",
    ];
    assert_eq!(states, expected);
    let frames = log.calls("xrEndFrame");
    assert_eq!(frames.len(), 6);
    let layers = |n: usize| frames[n].0["layers"].as_array().unwrap().len();
    assert_eq!([layers(0), layers(1), layers(5)], [0, 1, 1], "the first frame is not to be rendered");
    let view = &frames[3].0["layers"][0]["views"][1];
    assert_eq!(view["rect"], serde_json::json!([0, 0, 96, 80]));
    assert!((view["pose"][4].as_f64().unwrap() - 0.0315).abs() < 1e-6, "{view}");
    for (eye, colour) in [[255, 0, 0, 255], [0, 0, 255, 255u8]].iter().enumerate() {
        let bytes = std::fs::read(pictures.path().join(format!("view{eye}.raw"))).unwrap();
        assert_eq!(bytes.len(), 96 * 80 * 4);
        assert!(bytes.chunks(4).all(|pixel| pixel == colour), "eye {eye}");
    }
}

#[test]
fn each_mistake_is_found() {
    if !possible() {
        return;
    }
    let mistakes = [
        ("no requirements", "xrCreateSession: xrGetVulkanGraphicsRequirements2KHR comes first"),
        ("own device", "xrCreateSession: instance, physical device and device do not come from"),
        ("begin early", "xrBeginSession: the session was told to be Unknown"),
        ("end session early", "xrEndSession: the session was told to be"),
        ("begin without wait", "xrBeginFrame: xrBeginFrame without xrWaitFrame"),
        ("end without begin", "xrEndFrame: xrEndFrame without xrBeginFrame"),
        ("another time", "xrEndFrame: frame 3 is for"),
        ("no time", "xrLocateViews: the time 0 is none"),
        ("never drawn", "xrEndFrame: a layer shows a swapchain of which no image was released"),
        ("release without wait", "xrReleaseSwapchainImage: xrReleaseSwapchainImage of an image that was not"),
        ("acquire too many", "xrAcquireSwapchainImage: xrAcquireSwapchainImage where all images"),
        ("rectangle outside", "xrEndFrame: Rect2Di"),
        ("pose of no length", "xrEndFrame: the pose's orientation has no length of 1"),
        ("no field of view", "is no field of view"),
        ("one view", "xrEndFrame: 1 views in a layer of 2"),
        ("wrong type", "xrEndFrame: FRAME_STATE stands where FRAME_END_INFO must"),
        ("attach twice", "xrAttachSessionActionSets: the action sets are attached already"),
        ("sync unattached", "xrSyncActions: an action set is synchronised that the session does not have"),
        ("no such input", "/user/hand/left/input/thumbstick/y is not of /interaction_profiles/khr"),
        ("stale handle", "xrAcquireSwapchainImage: there is no Swapchain"),
        ("depth not enabled", "xrEndFrame: XR_KHR_composition_layer_depth is not enabled"),
        ("depth too far", "xrEndFrame: depths from 0.0..=2.0 are not between 0 and 1"),
        ("depth of no extent", "xrEndFrame: depth between 0.1 and 0.1 metres"),
        ("depth of colours", "xrEndFrame: depth in a swapchain of colours"),
    ];
    for (mistake, expected) in mistakes {
        let violations = run(mistake, &Script::default()).violations();
        assert!(violations.iter().any(|v| v.contains(expected)), "{mistake}: {violations:?}");
    }
    if application::validates() {
        let (_, said) = run_and_listen("wrong layout", &Script::default());
        assert!(said.contains("VUID"), "{said}");
    } else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "Vulkan's validation layer is missing");
        println!("not run: Vulkan's validation layer is missing");
    }
    if validation::installed() {
        for (mistake, expected) in [
            ("", None),
            ("wrong layout", Some("VUID-")),
            ("wrong type", Some("VUID-XrFrameEndInfo-type-type")),
            ("stale handle", Some("VUID-xrAcquireSwapchainImage-swapchain-parameter")),
        ] {
            let messages = run_under_layers(mistake, &Script::default());
            match expected {
                None => assert_eq!(messages, Vec::<String>::new()),
                Some(expected) => {
                    assert!(messages.iter().any(|m| m.contains(expected)), "{mistake}: {messages:?}");
                }
            }
        }
    }
    for (mistake, expected) in [("instance left", "Instance"), ("space left", "Space")] {
        let leftovers = run(mistake, &Script::default()).leftovers();
        assert!(leftovers.iter().any(|l| l.contains(expected)), "{mistake}: {leftovers:?}");
    }
}
