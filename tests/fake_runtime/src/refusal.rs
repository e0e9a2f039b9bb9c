//! Why a call is refused.

use openxr_sys as xr;

/// Why a call is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The application did nothing wrong, or the specification lets it try.
    Answer(xr::Result),
    /// The application broke a rule.
    Wrong(xr::Result, String),
}

/// The result of a call's body: a code of success, or a refusal.
pub(crate) type Outcome = Result<xr::Result, Refusal>;

/// A broken rule, told in words.
pub(crate) fn wrong(result: xr::Result, what: impl Into<String>) -> Refusal {
    Refusal::Wrong(result, what.into())
}

/// Calls in an order that OpenXR does not allow.
pub(crate) fn out_of_order(what: impl Into<String>) -> Refusal {
    wrong(xr::Result::ERROR_CALL_ORDER_INVALID, what)
}

/// A rule that belongs to no code of its own.
pub(crate) fn invalid(what: impl Into<String>) -> Refusal {
    wrong(xr::Result::ERROR_VALIDATION_FAILURE, what)
}

impl From<xr::Result> for Refusal {
    fn from(result: xr::Result) -> Self {
        Refusal::Answer(result)
    }
}

/// The code with this name, such as `ERROR_SESSION_LOST`.
pub(crate) fn named(name: &str) -> Option<xr::Result> {
    // Those of extensions have numbers of their own.
    let extensions = [
        xr::Result::ERROR_EXTENSION_DEPENDENCY_NOT_ENABLED,
        xr::Result::ERROR_DISPLAY_REFRESH_RATE_UNSUPPORTED_FB,
    ];
    (-60..=10).map(xr::Result::from_raw).chain(extensions).find(|result| format!("{result:?}") == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_have_names() {
        assert_eq!(named("ERROR_SESSION_LOST"), Some(xr::Result::ERROR_SESSION_LOST));
        assert_eq!(named("TIMEOUT_EXPIRED"), Some(xr::Result::TIMEOUT_EXPIRED));
        assert_eq!(named("ERROR_OF_MINE"), None);
    }
}
