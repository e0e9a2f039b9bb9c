//! Kernel source to a built program.

use opencl3::error_codes::{CL_INVALID_KERNEL_NAME, ClError};
use opencl3::{kernel, program};

use super::owned::Owned;
use super::{Device, Kernel};
use crate::error::{Error, Result};

/// A program built for one device, perhaps of several that OpenCL knows; released when dropped.
#[derive(Debug)]
pub struct Program {
    programs: Vec<Owned<program::Program>>,
    device: Device,
    name: String,
}

impl Program {
    /// Builds `source` with `options`; drivers keep their own cache of built programs.
    ///
    /// # Errors
    /// [`Error::Kernel`] with the compiler's first error line.
    pub fn build(device: &Device, name: &str, source: &str, options: &str) -> Result<Program> {
        let program = program::Program::create_from_source(device.context(), source)
            .map_err(|e| device.failed("refuses a program", e))?;
        let mut program = Owned::new(program);
        program.build(&[device.id()], options).map_err(|_| Error::Kernel {
            kernel: name.to_string(),
            device: device.info().name.clone(),
            log: first_error(&program.get_build_log(device.id()).unwrap_or_default()),
        })?;
        Ok(Program { device: device.clone(), programs: vec![program], name: name.to_string() })
    }

    /// This one with the kernels of another one for the same device.
    #[must_use]
    pub fn with(mut self, other: Program) -> Program {
        self.programs.extend(other.programs);
        self
    }

    /// A kernel of this program.
    ///
    /// # Errors
    /// [`Error::Device`] where the program has no such kernel.
    pub fn kernel(&self, name: &str) -> Result<Kernel> {
        let mut failed = ClError(CL_INVALID_KERNEL_NAME);
        for program in &self.programs {
            match kernel::Kernel::create(program, name) {
                Ok(kernel) => return Ok(Kernel::new(self.device.clone(), kernel)),
                Err(ClError(CL_INVALID_KERNEL_NAME)) => {}
                Err(error) => failed = error,
            }
        }
        Err(self.device.failed(&format!("finds no kernel {name} in {}", self.name), failed))
    }
}

/// The first line of a compiler's log that tells of an error.
fn first_error(log: &str) -> String {
    let line = log.lines().find(|l| l.contains("error")).or_else(|| log.lines().next());
    line.unwrap_or("the driver gives no reason").trim().to_string()
}
