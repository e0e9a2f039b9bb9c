//! Which devices are used.

use serde::{Deserialize, Serialize};

/// Which devices are used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
}
