//! What a kernel can read, and the macro that writes a struct down for both sides.

/// A type that a kernel can read: its OpenCL C name, and what follows a variable of it.
pub(super) trait KernelType {
    /// Its name.
    fn c_name() -> String;
    /// What follows a variable of it.
    fn c_suffix() -> String {
        String::new()
    }
}

impl KernelType for f32 {
    fn c_name() -> String {
        "float".to_string()
    }
}

impl KernelType for u32 {
    fn c_name() -> String {
        "uint".to_string()
    }
}

impl<T: KernelType, const N: usize> KernelType for [T; N] {
    fn c_name() -> String {
        T::c_name()
    }
    fn c_suffix() -> String {
        format!("[{N}]{}", T::c_suffix())
    }
}

/// Defines structs for the host, and writes them down in OpenCL C.
macro_rules! shared_structs {
    ($($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $type:ty,)*
    })*) => {
        $($(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                bytemuck::Zeroable::zeroed()
            }
        }

        impl $crate::layout::kernel_type::KernelType for $name {
            fn c_name() -> String {
                stringify!($name).to_string()
            }
        })*

        /// These structs in OpenCL C.
        pub(super) fn opencl() -> String {
            let mut text = String::new();
            $(
                text += "typedef struct {\n";
                $(text += &format!(
                    "    {} {}{};\n",
                    <$type as $crate::layout::kernel_type::KernelType>::c_name(),
                    stringify!($field),
                    <$type as $crate::layout::kernel_type::KernelType>::c_suffix()
                );)*
                text += concat!("} ", stringify!($name), ";\n\n");
            )*
            text
        }
    };
}
pub(super) use shared_structs;
