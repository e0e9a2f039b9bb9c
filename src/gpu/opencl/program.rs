//! Kernel source to a built program.

use opencl3::{kernel, program};

use super::owned::Owned;
use super::{Device, Kernel};
use crate::error::{Error, Result};

/// A program built for one device; released when dropped.
#[derive(Debug)]
pub struct Program {
    program: Owned<program::Program>,
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
        Ok(Program { device: device.clone(), program, name: name.to_string() })
    }

    /// A kernel of this program.
    ///
    /// # Errors
    /// [`Error::Device`] where the program has no such kernel.
    pub fn kernel(&self, name: &str) -> Result<Kernel> {
        let kernel = kernel::Kernel::create(&self.program, name)
            .map_err(|e| self.device.failed(&format!("finds no kernel {name} in {}", self.name), e))?;
        Ok(Kernel::new(self.device.clone(), kernel))
    }
}

/// The first line of a compiler's log that tells of an error.
fn first_error(log: &str) -> String {
    let line = log.lines().find(|l| l.contains("error")).or_else(|| log.lines().next());
    line.unwrap_or("the driver gives no reason").trim().to_string()
}
