//! Buffer views compressed by meshoptimizer (EXT_meshopt_compression and its successor of Khronos).
//!
//! The decoders are meshoptimizer's own, in C++, which are made for data that nobody vouches for; what they
//! take for granted (strides, counts) is checked here.

use bytemuck::{cast_slice, pod_collect_to_vec};

use super::super::json::Meshopt;

/// The bytes that a view stands for, or a clause about what is wrong with it.
pub fn decode(bytes: &[u8], view: &Meshopt) -> Result<Vec<u8>, String> {
    let (count, stride) = (view.count.0, view.byte_stride.0);
    let damaged = |_| String::from("is damaged");
    match (view.mode.as_str(), stride) {
        ("ATTRIBUTES", 4..=256) if stride % 4 == 0 => {
            let decoded = vertices(bytes, count, stride).ok_or("is damaged")?;
            filter(decoded, stride, view.filter.as_deref().unwrap_or("NONE"))
        }
        ("TRIANGLES", _) if !count.is_multiple_of(3) => {
            Err("has indices that are not a multiple of three".into())
        }
        ("TRIANGLES", 2) => meshopt::decode_index_buffer::<u16>(bytes, count)
            .map(|list| cast_slice(&list).to_vec())
            .map_err(damaged),
        ("TRIANGLES", 4) => meshopt::decode_index_buffer::<u32>(bytes, count)
            .map(|list| cast_slice(&list).to_vec())
            .map_err(damaged),
        ("INDICES", 2) => meshopt::decode_index_sequence::<u16>(bytes, count)
            .map(|list| cast_slice(&list).to_vec())
            .map_err(damaged),
        ("INDICES", 4) => meshopt::decode_index_sequence::<u32>(bytes, count)
            .map(|list| cast_slice(&list).to_vec())
            .map_err(damaged),
        (mode, stride) => Err(format!("has the unknown mode {mode:?} or stride {stride}")),
    }
}

/// A vertex of so many bytes.
#[derive(Clone)]
struct Vertex<const SIZE: usize>([u8; SIZE]);

impl<const SIZE: usize> Default for Vertex<SIZE> {
    fn default() -> Self {
        Vertex([0; SIZE])
    }
}

/// `None` where the data is damaged.
fn vertices(bytes: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    fn of<const SIZE: usize>(bytes: &[u8], count: usize) -> Option<Vec<u8>> {
        let vertices = meshopt::decode_vertex_buffer::<Vertex<SIZE>>(bytes, count).ok()?;
        Some(vertices.iter().flat_map(|vertex| vertex.0).collect())
    }
    macro_rules! by_stride {
        ($($size:literal)*) => {
            match stride {
                $($size => of::<$size>(bytes, count),)*
                _ => None,
            }
        };
    }
    by_stride!(4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64 68 72 76 80 84 88 92 96 100 104 108 112 116 120 124 128
        132 136 140 144 148 152 156 160 164 168 172 176 180 184 188 192 196 200 204 208 212 216 220 224 228 232 236
        240 244 248 252 256)
}

fn filter(bytes: Vec<u8>, stride: usize, name: &str) -> Result<Vec<u8>, String> {
    macro_rules! filtered {
        ($kind:ty, $function:expr) => {{
            let mut values: Vec<$kind> = pod_collect_to_vec(&bytes);
            $function(&mut values);
            Ok(cast_slice(&values).to_vec())
        }};
    }
    match (name, stride) {
        ("NONE", _) => Ok(bytes),
        ("OCTAHEDRAL", 4) => filtered!([i8; 4], meshopt::decode_filter_oct::<i8>),
        ("OCTAHEDRAL", 8) => filtered!([i16; 4], meshopt::decode_filter_oct::<i16>),
        ("QUATERNION", 8) => filtered!([i16; 4], meshopt::decode_filter_quat),
        ("EXPONENTIAL", _) => filtered!([u32; 1], meshopt::decode_filter_exp::<1>),
        ("COLOR", 4) => filtered!([u8; 4], meshopt::decode_filter_color::<u8>),
        ("COLOR", 8) => filtered!([u16; 4], meshopt::decode_filter_color::<u16>),
        _ => Err(format!("has the filter {name:?}, which does not go with a stride of {stride}")),
    }
}
