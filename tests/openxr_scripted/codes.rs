//! What OpenXR 1.1's registry (xr.xml) lists for the calls that the program makes, and what is right to do about it:
//! the one table that `faults.rs` makes its tests from.

/// What is done about a code that has no remedy of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// The frame, or the session, goes on without what was asked for.
    GoesOn,
    /// A new session.
    Session,
    /// A new instance.
    Instance,
}

/// When a call is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// As a runtime is connected to: so many times where all goes well.
    Connect(u64),
    /// As its device is opened and a session made.
    Open,
    /// In a session, or for it: the one of these calls, counted in the session, that is looked at.
    Session(u64),
    /// As a session ends.
    End,
}

/// A call.
#[derive(Debug)]
pub struct Call {
    pub name: &'static str,
    pub part: Part,
    pub usual: Remedy,
    /// Codes besides those that every call of its part has.
    own: &'static [&'static str],
}

const fn call(name: &'static str, part: Part, usual: Remedy, own: &'static [&'static str]) -> Call {
    Call { name, part, usual, own }
}

/// Codes that every call with a handle has.
const ALL: [&str; 4] =
    ["ERROR_VALIDATION_FAILURE", "ERROR_RUNTIME_FAILURE", "ERROR_HANDLE_INVALID", "ERROR_INSTANCE_LOST"];

const SIZE: &str = "ERROR_SIZE_INSUFFICIENT";
const MEMORY: &str = "ERROR_OUT_OF_MEMORY";
const LIMIT: &str = "ERROR_LIMIT_REACHED";
const SYSTEM: &str = "ERROR_SYSTEM_INVALID";
const VIEWS: &str = "ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED";
const NOT_RUNNING: &str = "ERROR_SESSION_NOT_RUNNING";
const ORDER: &str = "ERROR_CALL_ORDER_INVALID";
const TIME: &str = "ERROR_TIME_INVALID";
const POSE: &str = "ERROR_POSE_INVALID";
const PATH: &str = "ERROR_PATH_INVALID";
const PATHS: &str = "ERROR_PATH_UNSUPPORTED";
const PATH_FORMAT: &str = "ERROR_PATH_FORMAT_INVALID";
const FUNCTION: &str = "ERROR_FUNCTION_UNSUPPORTED";
const MISMATCH: &str = "ERROR_ACTION_TYPE_MISMATCH";
const DETACHED: &str = "ERROR_ACTIONSET_NOT_ATTACHED";
const ATTACHED: &str = "ERROR_ACTIONSETS_ALREADY_ATTACHED";
const NAME: &str = "ERROR_NAME_INVALID";
const NAME_TWICE: &str = "ERROR_NAME_DUPLICATED";
const LABEL: &str = "ERROR_LOCALIZED_NAME_INVALID";
const LABEL_TWICE: &str = "ERROR_LOCALIZED_NAME_DUPLICATED";

use Part::{Connect, End, Open};
use Remedy::{GoesOn, Instance, Session};

/// Calls before there is a session, in the order in which they are made.
pub const BEFORE: [Call; 12] = [
    call(
        "xrCreateInstance",
        Connect(1),
        Instance,
        &[
            MEMORY,
            LIMIT,
            "ERROR_RUNTIME_UNAVAILABLE",
            NAME,
            "ERROR_INITIALIZATION_FAILED",
            "ERROR_EXTENSION_NOT_PRESENT",
            "ERROR_EXTENSION_DEPENDENCY_NOT_ENABLED",
            "ERROR_API_LAYER_NOT_PRESENT",
        ],
    ),
    call("xrGetInstanceProperties", Connect(1), Instance, &[]),
    call(
        "xrGetSystem",
        Connect(1),
        Instance,
        &["ERROR_FORM_FACTOR_UNSUPPORTED", "ERROR_FORM_FACTOR_UNAVAILABLE"],
    ),
    call("xrEnumerateViewConfigurations", Connect(2), Instance, &[SIZE, SYSTEM]),
    call("xrEnumerateViewConfigurationViews", Connect(2), Instance, &[SIZE, VIEWS, SYSTEM]),
    call("xrEnumerateEnvironmentBlendModes", Connect(2), Instance, &[SIZE, VIEWS, SYSTEM]),
    call("xrGetVulkanGraphicsRequirements2KHR", Open, Instance, &[FUNCTION, SYSTEM]),
    call("xrCreateVulkanInstanceKHR", Open, Instance, &[FUNCTION, MEMORY, LIMIT, SYSTEM]),
    call("xrGetVulkanGraphicsDevice2KHR", Open, Instance, &[FUNCTION, SYSTEM]),
    call("xrCreateVulkanDeviceKHR", Open, Instance, &[FUNCTION, MEMORY, LIMIT, SYSTEM]),
    call(
        "xrCreateSession",
        Open,
        Session,
        &[
            MEMORY,
            LIMIT,
            SYSTEM,
            "ERROR_INITIALIZATION_FAILED",
            "ERROR_GRAPHICS_REQUIREMENTS_CALL_MISSING",
            "ERROR_GRAPHICS_DEVICE_INVALID",
        ],
    ),
    call("xrPollEvent", Open, Instance, &[]),
];

/// Calls of a session. Those that make something and those of frames take turns, so that sessions that show nothing
/// are not too many in a row.
pub const SESSIONS: [Call; 34] = [
    call(
        "xrCreateReferenceSpace",
        Part::Session(1),
        Session,
        &[MEMORY, LIMIT, "ERROR_REFERENCE_SPACE_UNSUPPORTED", POSE],
    ),
    call("xrLocateViews", Part::Session(10), GoesOn, &[SIZE, VIEWS, TIME]),
    call("xrWaitFrame", Part::Session(4), Session, &[NOT_RUNNING]),
    call("xrEnumerateSwapchainFormats", Part::Session(1), Session, &[SIZE]),
    call("xrSyncActions", Part::Session(2), GoesOn, &[PATHS, PATH, DETACHED]),
    call("xrBeginFrame", Part::Session(4), Session, &[NOT_RUNNING, ORDER]),
    call("xrEnumerateSwapchainImages", Part::Session(1), Session, &[SIZE]),
    call("xrLocateSpace", Part::Session(2), GoesOn, &[TIME]),
    call(
        "xrEndFrame",
        Part::Session(4),
        Session,
        &[
            TIME,
            "ERROR_SWAPCHAIN_RECT_INVALID",
            NOT_RUNNING,
            POSE,
            "ERROR_LAYER_LIMIT_EXCEEDED",
            "ERROR_LAYER_INVALID",
            "ERROR_ENVIRONMENT_BLEND_MODE_UNSUPPORTED",
            ORDER,
        ],
    ),
    call(
        "xrBeginSession",
        Part::Session(1),
        Session,
        &[VIEWS, "ERROR_SESSION_RUNNING", "ERROR_SESSION_NOT_READY"],
    ),
    call("xrGetActionStatePose", Part::Session(3), GoesOn, &[PATHS, PATH, MISMATCH, DETACHED]),
    call("xrAcquireSwapchainImage", Part::Session(8), Session, &[ORDER]),
    call(
        "xrCreateSwapchain",
        Part::Session(1),
        GoesOn,
        &[MEMORY, LIMIT, "ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED", "ERROR_FEATURE_UNSUPPORTED"],
    ),
    call("xrWaitSwapchainImage", Part::Session(8), Session, &[ORDER]),
    call("xrCreateActionSpace", Part::Session(1), GoesOn, &[MEMORY, LIMIT, POSE, PATHS, PATH, MISMATCH]),
    call("xrGetCurrentInteractionProfile", Part::Session(3), GoesOn, &[PATH, PATHS, DETACHED]),
    call("xrReleaseSwapchainImage", Part::Session(8), Session, &[ORDER]),
    call(
        "xrCreateHandTrackerEXT",
        Part::Session(1),
        GoesOn,
        &[MEMORY, LIMIT, FUNCTION, "ERROR_FEATURE_UNSUPPORTED"],
    ),
    call("xrAttachSessionActionSets", Part::Session(1), GoesOn, &[ATTACHED]),
    call("xrGetActionStateBoolean", Part::Session(3), GoesOn, &[PATHS, PATH, MISMATCH, DETACHED]),
    call("xrLocateHandJointsEXT", Part::Session(3), GoesOn, &[FUNCTION, TIME]),
    call("xrEnumerateReferenceSpaces", Part::Session(1), GoesOn, &[SIZE]),
    call("xrGetVisibilityMaskKHR", Part::Session(1), GoesOn, &[FUNCTION, SIZE, VIEWS]),
    call("xrGetActionStateVector2f", Part::Session(5), GoesOn, &[PATHS, PATH, MISMATCH, DETACHED]),
    call("xrEnumerateDisplayRefreshRatesFB", Part::Session(1), GoesOn, &[FUNCTION, SIZE]),
    call(
        "xrRequestDisplayRefreshRateFB",
        Part::Session(1),
        GoesOn,
        &[FUNCTION, "ERROR_FEATURE_UNSUPPORTED", "ERROR_DISPLAY_REFRESH_RATE_UNSUPPORTED_FB"],
    ),
    call("xrPerfSettingsSetPerformanceLevelEXT", Part::Session(1), GoesOn, &[FUNCTION]),
    call(
        "xrCreateActionSet",
        Part::Open,
        GoesOn,
        &[MEMORY, LIMIT, PATH_FORMAT, NAME, NAME_TWICE, LABEL, LABEL_TWICE],
    ),
    call(
        "xrCreateAction",
        Part::Open,
        GoesOn,
        &[MEMORY, LIMIT, PATHS, PATH, PATH_FORMAT, NAME, NAME_TWICE, LABEL, LABEL_TWICE, ATTACHED],
    ),
    call("xrStringToPath", Part::Open, GoesOn, &[PATH_FORMAT, "ERROR_PATH_COUNT_EXCEEDED"]),
    call("xrSuggestInteractionProfileBindings", Part::Open, GoesOn, &[PATHS, PATH, ATTACHED]),
    call("xrGetSystemProperties", Part::Open, GoesOn, &[MEMORY, SYSTEM]),
    call("xrConvertTimespecTimeToTimeKHR", Part::Open, GoesOn, &[FUNCTION, TIME]),
    call("xrRequestExitSession", End, GoesOn, &[NOT_RUNNING]),
];

/// The call that ends a session; what it says is too late to matter.
pub const ENDS: Call = call("xrEndSession", End, Session, &["ERROR_SESSION_NOT_STOPPING", NOT_RUNNING]);

impl Call {
    /// Its codes. Those without an instance, and those without a session, have fewer.
    pub fn codes(&self) -> Vec<&'static str> {
        let has_session = matches!(self.part, Part::Session(_) | End);
        let all = ALL.into_iter().filter(|code| {
            self.name != "xrCreateInstance"
                || !matches!(*code, "ERROR_HANDLE_INVALID" | "ERROR_INSTANCE_LOST")
        });
        let session = has_session.then_some("ERROR_SESSION_LOST");
        all.chain(session).chain(self.own.iter().copied()).collect()
    }

    /// What is right to do about one of its codes.
    pub fn remedy(&self, code: &str) -> Remedy {
        match code {
            "ERROR_INSTANCE_LOST" => Instance,
            "ERROR_SESSION_LOST" => Session,
            _ if self.usual == GoesOn => GoesOn,
            "ERROR_RUNTIME_FAILURE" | "ERROR_INITIALIZATION_FAILED" | SYSTEM => Instance,
            _ => self.usual,
        }
    }
}

/// The codes that a registry lists for a call, where it knows it: its own, or those of the call whose alias it is.
fn listed<'a>(registry: &'a str, name: &str) -> Option<Vec<&'a str>> {
    let at = registry.find(&format!("<name>{name}</name>"))?;
    let command = &registry[registry[..at].rfind("<command")?..at];
    let (_, rest) = command.split_once("errorcodes=\"")?;
    let codes = rest.split('"').next()?.split(',');
    Some(codes.map(|code| code.trim_start_matches("XR_")).collect())
}

/// The table is the registry's, which the crate openxr-sys brings along.
#[test]
fn the_table_lists_what_the_registry_lists() {
    let home = std::env::var_os("CARGO_HOME").map(std::path::PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo"))).unwrap_or_default();
    let crates = std::fs::read_dir(home.join("registry/src")).into_iter().flatten().flatten();
    let crates = crates.flat_map(|index| std::fs::read_dir(index.path()).into_iter().flatten().flatten());
    let named = |path: &std::path::Path| path.to_string_lossy().contains("openxr-sys-0.14");
    let found = crates.map(|entry| entry.path()).find(|path| named(path));
    let text = found
        .and_then(|path| std::fs::read_to_string(path.join("OpenXR-SDK/specification/registry/xr.xml")).ok());
    let Some(registry) = text else { return println!("not run: no registry of OpenXR beside the crates") };
    let mut compared = 0;
    for call in BEFORE.iter().chain(&SESSIONS).chain([&ENDS]) {
        // Aliases have no list of their own.
        let Some(mut right) = listed(&registry, call.name) else { continue };
        // The program falls back to OpenXR 1.0 there: no failure.
        right.retain(|code| *code != "ERROR_API_VERSION_UNSUPPORTED");
        let mut ours = call.codes();
        right.sort_unstable();
        ours.sort_unstable();
        assert_eq!(ours, right, "{}", call.name);
        compared += 1;
    }
    assert!(compared > 40, "{compared}");
}
