//! What goes wrong with a headset, by what is to be built anew.

use crate::error::Error;

/// What a headset's call may end with.
pub type Outcome<T> = std::result::Result<T, Fault>;

/// Why a call failed.
#[derive(Debug)]
pub enum Fault {
    /// What was asked for is not to be had now: goes on without it, and asks again.
    Passing(String),
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

/// The next step where an OpenXR runtime has failed.
pub(super) const NEXT: &str = "look at the OpenXR runtime's window or log, and start it again";

impl Fault {
    /// What happened, and the next step.
    pub fn sentence(&self) -> String {
        match self {
            Fault::Fatal(error) => error.to_string(),
            Fault::Passing(problem) => format!("{problem}; {NEXT}"),
            Fault::Session(problem) | Fault::Instance(problem) => problem.clone(),
        }
    }

    /// The error to end with where nothing is built anew.
    pub fn into_error(self) -> Error {
        match self {
            Fault::Fatal(error) => error,
            lost => {
                let told = lost.sentence();
                let problem = if told.contains("; ") { told } else { format!("{told}; {NEXT}") };
                Error::NoDevice { kind: "OpenXR", problem }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_ends_is_told_the_next_step() {
        for (told, whole) in
            [("it fails", format!("it fails; {NEXT}")), ("it fails; mend it", "it fails; mend it".into())]
        {
            for fault in [Fault::Session(told.into()), Fault::Instance(told.into())] {
                assert!(fault.into_error().to_string().ends_with(&whole));
            }
        }
    }
}
