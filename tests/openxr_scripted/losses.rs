//! Sessions and instances that are lost, and calls that fail.

use fake_runtime::script::{Event, EventKind, Fault, Script, Session};

use super::{run, sessions};

fn fault(call: &str, from: u64, result: &str) -> Fault {
    Fault { call: call.into(), from, to: 0, result: result.into() }
}

fn failing(call: &str, from: u64, result: &str) -> Session {
    Session { faults: vec![fault(call, from, result)], ..Session::default() }
}

#[test]
fn a_session_lost_at_any_call_is_replaced() {
    let calls = [
        ("xrWaitFrame", 4),
        ("xrBeginFrame", 4),
        ("xrLocateViews", 3),
        ("xrAcquireSwapchainImage", 5),
        ("xrWaitSwapchainImage", 5),
        ("xrReleaseSwapchainImage", 6),
        ("xrEndFrame", 4),
        ("xrBeginSession", 1),
        ("xrCreateSwapchain", 2),
        ("xrEnumerateSwapchainImages", 3),
        ("xrCreateReferenceSpace", 1),
        ("xrEnumerateSwapchainFormats", 1),
    ];
    let lost = calls.map(|(call, nth)| failing(call, nth, "ERROR_SESSION_LOST")).to_vec();
    let Some(run) = run(&sessions(lost), 40, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(
        (told["frames"].as_u64(), told["losses"].as_u64()),
        (Some(40), Some(calls.len() as u64)),
        "{told}"
    );
    for (call, _) in calls {
        let hit =
            |r: &&fake_runtime::log::Record| r.result() == "ERROR_SESSION_LOST" && r.0["scripted"] == true;
        assert_eq!(run.log.calls(call).into_iter().filter(hit).count(), 1, "{call}");
    }
}

#[test]
fn an_instance_lost_at_any_call_is_replaced() {
    let calls = [("xrWaitFrame", 4), ("xrEndFrame", 4), ("xrLocateViews", 4), ("xrEndSession", 1)];
    let lost = calls.map(|(call, nth)| failing(call, nth, "ERROR_INSTANCE_LOST")).to_vec();
    let Some(run) = run(&sessions(lost), 20, "") else { return };
    let told = run.is_clean().told();
    // The last one is lost as it ends, when it has shown all frames, and needs no other.
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(20), Some(3)), "{told}");
    assert_eq!(run.log.calls("xrCreateInstance").len(), 4);
    assert!(run.said.contains("is back"), "{}", run.said);
}

#[test]
fn a_runtime_that_announces_its_end_and_stays_away_for_a_while_is_waited_for() {
    let ends = Event { frame: 4, event: EventKind::InstanceLossPending };
    let script = Script {
        sessions: vec![Session { events: vec![ends], ..Session::default() }],
        faults: vec![
            Fault { to: 3, ..fault("xrCreateInstance", 2, "ERROR_RUNTIME_UNAVAILABLE") },
            Fault { to: 3, ..fault("xrGetSystem", 2, "ERROR_FORM_FACTOR_UNAVAILABLE") },
        ],
        ..Script::default()
    };
    let Some(run) = run(&script, 10, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(10), Some(1)), "{told}");
    assert!(run.said.contains("waiting for it to come back") && run.said.contains("is back"), "{}", run.said);
}

#[test]
fn swapchains_that_fail_are_made_anew() {
    let calls = [
        ("xrAcquireSwapchainImage", "ERROR_RUNTIME_FAILURE"),
        ("xrWaitSwapchainImage", "ERROR_RUNTIME_FAILURE"),
        ("xrReleaseSwapchainImage", "ERROR_CALL_ORDER_INVALID"),
        ("xrEndFrame", "ERROR_SWAPCHAIN_RECT_INVALID"),
        ("xrEndFrame", "ERROR_LAYER_INVALID"),
    ];
    let failures = calls.map(|(call, result)| failing(call, 5, result)).to_vec();
    let Some(run) = run(&sessions(failures), 20, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(20), Some(5)), "{told}");
}

#[test]
fn a_runtime_that_never_works_ends_in_one_sentence() {
    let never = |call: &str, result: &str| Fault { to: 1000, ..fault(call, 1, result) };
    for (call, result) in [
        ("xrCreateSession", "ERROR_RUNTIME_FAILURE"),
        ("xrCreateSwapchain", "ERROR_OUT_OF_MEMORY"),
        ("xrCreateInstance", "ERROR_RUNTIME_UNAVAILABLE"),
        ("xrGetSystem", "ERROR_FORM_FACTOR_UNAVAILABLE"),
        ("xrCreateVulkanInstanceKHR", "ERROR_RUNTIME_FAILURE"),
        ("xrEndFrame", "ERROR_RUNTIME_FAILURE"),
    ] {
        let script = Script { faults: vec![never(call, result)], ..Script::default() };
        let Some(run) = run(&script, 5, "") else { return };
        assert_eq!(run.code, Some(1), "{call}: {}", run.said);
        // What was done is told as soon as there was a session.
        assert!(run.out.is_empty() || run.told()["frames"] == 0, "{call}: {}", run.out);
        let last = run.said.trim_end().lines().last().unwrap();
        let told: serde_json::Value = serde_json::from_str(last).unwrap_or_default();
        let message = told["error"]["message"].as_str().unwrap_or_default();
        assert!(message.len() > 40, "{call}: {}", run.said);
        assert_eq!(run.log.violations(), Vec::<String>::new(), "{call}");
        assert_eq!(run.log.leftovers(), Vec::<String>::new(), "{call}: {}", run.said);
    }
}
