//! Has the tests find drivers where foveate's are.

include!("../../build/drivers.rs");

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../../build/drivers.rs");
    link_with_unpacked_drivers("../..");
}
