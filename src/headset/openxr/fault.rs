//! What goes wrong behind OpenXR, and what is done about it: the one place that says so.
//!
//! | what | remedy |
//! | --- | --- |
//! | views that cannot be located, hands and eyes that cannot be asked, a format that is refused | goes on without, and tries again |
//! | a board with messages that is refused, by xrCreateSwapchain or xrEndFrame | goes on without it |
//! | a session that is lost, and any other code while it runs | a new session |
//! | a runtime that is lost or fails, a headset that is away | a new instance, as soon as there is one |
//! | a remedy that has not helped for several times in a row | the next one; after the last the program ends with the reason |

use openxr::sys;

use crate::headset::fault::NEXT;
pub use crate::headset::fault::{Fault, Outcome};

/// Calls that frames, or sessions, can do without.
const DISPENSABLE: [&str; 18] = [
    "xrLocateViews",
    "xrLocateSpace",
    "xrSyncActions",
    "xrGetActionStatePose",
    "xrGetActionStateBoolean",
    "xrGetActionStateVector2f",
    "xrCreateActionSet",
    "xrCreateAction",
    "xrCreateActionSpace",
    "xrAttachSessionActionSets",
    "xrGetCurrentInteractionProfile",
    "xrGetSystemProperties",
    "xrCreateHandTrackerEXT",
    "xrLocateHandJointsEXT",
    "xrStringToPath",
    "xrGetVisibilityMaskKHR",
    "xrCreateSwapchain",
    "xrRequestExitSession",
];

/// Calls that come before there is a session.
const BEFORE_SESSIONS: [&str; 11] = [
    "xrCreateInstance",
    "xrGetInstanceProperties",
    "xrGetSystem",
    "xrEnumerateViewConfigurations",
    "xrEnumerateViewConfigurationViews",
    "xrEnumerateEnvironmentBlendModes",
    "xrGetVulkanGraphicsRequirements2KHR",
    "xrCreateVulkanInstanceKHR",
    "xrGetVulkanGraphicsDevice2KHR",
    "xrCreateVulkanDeviceKHR",
    "xrPollEvent",
];

impl Fault {
    /// The fault behind a code that a call named `what` has returned.
    pub(super) fn of(what: &str, code: sys::Result) -> Fault {
        let problem = format!("{what} failed ({code:?})");
        let next = |problem: String| format!("{problem}; {NEXT}");
        match code {
            sys::Result::ERROR_INSTANCE_LOST => Fault::Instance(next(problem)),
            sys::Result::ERROR_SESSION_LOST => Fault::Session(next(problem)),
            _ if DISPENSABLE.contains(&what) => Fault::Passing(problem),
            _ if BEFORE_SESSIONS.contains(&what) => Fault::Instance(next(problem)),
            sys::Result::ERROR_RUNTIME_FAILURE
            | sys::Result::ERROR_RUNTIME_UNAVAILABLE
            | sys::Result::ERROR_INITIALIZATION_FAILED
            | sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE
            | sys::Result::ERROR_SYSTEM_INVALID => Fault::Instance(next(problem)),
            _ => Fault::Session(next(problem)),
        }
    }
}

/// Names the call that a result came from.
pub(super) trait Called<T> {
    /// The same as an [`Outcome`].
    fn called(self, what: &str) -> Outcome<T>;
}

impl<T> Called<T> for Result<T, sys::Result> {
    fn called(self, what: &str) -> Outcome<T> {
        self.map_err(|code| Fault::of(what, code))
    }
}

/// What is told of faults that pass: each once.
#[derive(Debug, Default)]
pub(super) struct Notes {
    told: std::collections::BTreeSet<String>,
    new: Vec<String>,
}

impl Notes {
    /// Takes an outcome; what passes is noted with what is done `instead`, and is nothing.
    pub fn or_without<T>(&mut self, outcome: Outcome<T>, instead: &str) -> Outcome<Option<T>> {
        match outcome {
            Ok(value) => Ok(Some(value)),
            Err(Fault::Passing(problem)) => {
                self.note(format!("{problem}: {instead}"));
                Ok(None)
            }
            Err(lost) => Err(lost),
        }
    }

    /// Notes a sentence, unless it was told before.
    pub fn note(&mut self, sentence: String) {
        if self.told.insert(sentence.clone()) {
            self.new.push(sentence);
        }
    }

    /// What has not been told yet.
    pub fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_code_of_any_call_ends_the_program_at_once() {
        let calls = DISPENSABLE.iter().chain(&BEFORE_SESSIONS).chain(&["xrWaitFrame", "xrEndFrame"]);
        for call in calls {
            for code in (-60..0).map(sys::Result::from_raw) {
                let fault = Fault::of(call, code);
                assert!(!matches!(fault, Fault::Fatal(_)), "{call} {code:?}");
                assert!(fault.sentence().starts_with(call) && fault.sentence().ends_with(NEXT));
                let lost = code == sys::Result::ERROR_INSTANCE_LOST;
                assert!(!lost || matches!(fault, Fault::Instance(_)), "{call}");
            }
        }
    }

    #[test]
    fn what_passes_is_told_once() {
        let mut notes = Notes::default();
        for _ in 0..3 {
            let refused = Fault::of("xrSyncActions", sys::Result::ERROR_VALIDATION_FAILURE);
            assert!(notes.or_without::<()>(Err(refused), "hands are not asked").unwrap().is_none());
        }
        assert_eq!(notes.take().len(), 1);
        assert!(notes.or_without(Ok(1), "").unwrap() == Some(1) && notes.take().is_empty());
    }
}
