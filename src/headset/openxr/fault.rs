//! What goes wrong behind OpenXR, by what has to be built anew.

use openxr::sys;

use crate::error::Error;

/// What an OpenXR call may end with.
pub type Outcome<T> = std::result::Result<T, Fault>;

/// Why a call failed.
#[derive(Debug)]
pub enum Fault {
    /// The session is gone: a new one goes on.
    Session(String),
    /// The runtime is gone: everything that came from it is built anew once it answers again.
    Instance(String),
    /// Nothing that a new start would mend.
    Fatal(Error),
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Fault::Fatal(error)
    }
}

impl Fault {
    /// The fault behind a code that a call named `what` has returned.
    pub(super) fn of(what: &str, code: sys::Result) -> Fault {
        let problem = format!("{what} failed ({code:?}); {NEXT}");
        match code {
            sys::Result::ERROR_INSTANCE_LOST
            | sys::Result::ERROR_RUNTIME_FAILURE
            | sys::Result::ERROR_RUNTIME_UNAVAILABLE
            | sys::Result::ERROR_INITIALIZATION_FAILED => Fault::Instance(problem),
            sys::Result::ERROR_SESSION_LOST
            | sys::Result::ERROR_FORM_FACTOR_UNAVAILABLE
            | sys::Result::ERROR_SYSTEM_INVALID => Fault::Session(problem),
            _ => Fault::Fatal(Error::Device { device: "the OpenXR runtime".into(), problem }),
        }
    }

    /// The same where a new session may mend it: swapchains and layers that are refused are made anew with
    /// it.
    pub(super) fn spoilt(self) -> Fault {
        match self {
            Fault::Fatal(error) => Fault::Session(error.to_string()),
            lost => lost,
        }
    }

    /// What happened, and the next step.
    pub fn sentence(&self) -> String {
        match self {
            Fault::Fatal(error) => error.to_string(),
            Fault::Session(problem) | Fault::Instance(problem) => problem.clone(),
        }
    }

    /// The error to end with where nothing is built anew.
    pub fn into_error(self) -> Error {
        match self {
            Fault::Fatal(error) => error,
            Fault::Session(problem) | Fault::Instance(problem) => Error::NoDevice { kind: "OpenXR", problem },
        }
    }
}

const NEXT: &str = "look at its own window or log, and start it again";

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
