//! Which devices are used.

use serde::{Deserialize, Serialize};

/// Which devices are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DevicesConfig {
    /// OpenCL devices that trace, separated by commas: their numbers in `foveate devices`, their UUIDs, or
    /// parts of their names. Empty: all that work.
    pub opencl: String,
    /// Compute units of the parts that each processor among them is divided into; what is left over stays
    /// free for other programs. Empty: it is used whole.
    pub subdivide: Vec<u32>,
    /// Vulkan device that reconstructs: a part of its name. Empty: the best.
    pub vulkan: String,
    /// Whether OpenCL devices time what they do. Without, reports have no times of tracing, shading, light and sharing, 0 in
    /// their places. Several devices always do, since they are balanced by it.
    pub profile: bool,
}

impl Default for DevicesConfig {
    fn default() -> Self {
        DevicesConfig { opencl: String::new(), subdivide: Vec::new(), vulkan: String::new(), profile: true }
    }
}
