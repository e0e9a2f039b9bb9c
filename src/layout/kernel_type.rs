//! What a kernel can read, and the macro that writes a struct down for both sides.

/// A type that a kernel can read: its OpenCL C name, and what follows a variable of it.
pub(super) trait KernelType {
    /// Its name.
    fn c_name() -> String;
    /// What follows a variable of it.
    fn c_suffix() -> String {
        String::new()
    }
    /// Its WGSL name where it lies at a multiple of 16 bytes.
    fn wgsl_name() -> String;
}

impl KernelType for f32 {
    fn c_name() -> String {
        "float".to_string()
    }
    fn wgsl_name() -> String {
        "f32".to_string()
    }
}

impl KernelType for u32 {
    fn c_name() -> String {
        "uint".to_string()
    }
    fn wgsl_name() -> String {
        "u32".to_string()
    }
}

impl<T: KernelType, const N: usize> KernelType for [T; N] {
    fn c_name() -> String {
        T::c_name()
    }
    fn c_suffix() -> String {
        format!("[{N}]{}", T::c_suffix())
    }
    fn wgsl_name() -> String {
        if N == 3 { format!("vec3<{}>", T::wgsl_name()) } else { format!("array<{}, {N}>", T::wgsl_name()) }
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
            fn wgsl_name() -> String {
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

        /// These structs in WGSL, where they lie as here: a vector of three begins at a multiple of 16 bytes.
        #[allow(dead_code)]
        pub(super) fn wgsl() -> String {
            use $crate::layout::kernel_type::KernelType;
            let mut text = String::new();
            $(
                text += concat!("struct ", stringify!($name), " {\n");
                $(
                    let name = <$type as KernelType>::wgsl_name();
                    let at = std::mem::offset_of!($name, $field);
                    assert!(!name.starts_with("vec3") || at % 16 == 0, "{} at {at}", stringify!($field));
                    text += &format!("    {}: {name},\n", stringify!($field));
                )*
                text += "}\n\n";
            )*
            text
        }
    };
}
pub(super) use shared_structs;
