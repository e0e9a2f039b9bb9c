//! Kernel source to a built program.
#![allow(unsafe_code)]

use std::ffi::CString;

use cl3::types::cl_program;

use super::{Device, Kernel};
use crate::error::{Error, Result};

/// A program built for one device; released when dropped.
#[derive(Debug)]
pub struct Program {
    device: Device,
    program: cl_program,
    name: String,
}

// SAFETY: cl_program handles may be used from any thread (OpenCL 1.2, appendix A.2).
unsafe impl Send for Program {}

impl Program {
    /// Builds `source` with `options`; drivers keep their own cache of built programs.
    ///
    /// # Errors
    /// [`Error::Kernel`] with the compiler's first error line.
    pub fn build(device: &Device, name: &str, source: &str, options: &str) -> Result<Program> {
        let program = cl3::program::create_program_with_source(device.context(), &[source])
            .map_err(|e| device.failed("refuses a program", e))?;
        let program = Program { device: device.clone(), program, name: name.to_string() };
        let options = CString::new(options).expect("options hold no zero byte");
        cl3::program::build_program(program.program, &[device.id()], &options, None, std::ptr::null_mut())
            .map_err(|_| Error::Kernel {
                kernel: name.to_string(),
                device: device.info().name.clone(),
                log: program.first_error(),
            })?;
        Ok(program)
    }

    fn first_error(&self) -> String {
        let log = cl3::program::get_program_build_info(
            self.program,
            self.device.id(),
            cl3::program::CL_PROGRAM_BUILD_LOG,
        )
        .map(String::from)
        .unwrap_or_default();
        let line = log.lines().find(|l| l.contains("error")).or_else(|| log.lines().next());
        line.unwrap_or("the driver gives no reason").trim().to_string()
    }

    /// A kernel of this program.
    ///
    /// # Errors
    /// [`Error::Device`] where the program has no such kernel.
    pub fn kernel(&self, name: &str) -> Result<Kernel> {
        let c_name = CString::new(name).expect("kernel names hold no zero byte");
        let kernel = cl3::kernel::create_kernel(self.program, &c_name)
            .map_err(|e| self.device.failed(&format!("finds no kernel {name} in {}", self.name), e))?;
        Ok(Kernel::new(self.device.clone(), kernel))
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // SAFETY: created by `build`, released once.
        let _ = unsafe { cl3::program::release_program(self.program) };
    }
}
