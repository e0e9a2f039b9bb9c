//! What the integration tests share: where the test data is, and the device that presents.

#![allow(dead_code)] // No test uses everything.

pub mod builder;
pub mod moving;
pub mod painted;
pub mod validation;

use std::path::PathBuf;

use foveate::gpu::vulkan::{Context, ContextOptions};

/// A Vulkan device under the validation layer; says so where there is none. On machines that promise one
/// (CI=true) that is a failure.
pub fn vulkan() -> Option<Context> {
    match Context::new(&ContextOptions { validation: true, ..ContextOptions::default() }) {
        Ok(context) => Some(context),
        Err(error) => {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "{error}");
            println!("not run: no Vulkan device ({error})");
            None
        }
    }
}

/// The same with ray queries switched on; says what is missing where no device has them, with CI=true as above.
pub fn ray_queries() -> Option<Context> {
    let options = ContextOptions { validation: true, ray_queries: true, ..ContextOptions::default() };
    let opened = Context::new(&options).map_err(|error| error.to_string()).and_then(|context| {
        let lacks = context.report().lacks_ray_queries.clone();
        lacks.map_or(Ok(context), Err)
    });
    match opened {
        Ok(context) => Some(context),
        Err(why) => {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "{why}");
            println!("not run: no Vulkan device has ray queries under the validation layer ({why})");
            None
        }
    }
}

/// A file or folder of the test data; says so on standard error when it is not there.
pub fn data(relative: &str) -> Option<PathBuf> {
    let root = std::env::var_os("FOVEATE_TEST_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(relative);
    if !path.exists() {
        eprintln!(
            "not run: {} is not there; set FOVEATE_TEST_DATA to the folder that holds {relative}",
            path.display()
        );
        return None;
    }
    Some(path)
}
