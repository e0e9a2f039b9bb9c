//! An OpenCL layer (`cl_loader_layers`) for processors: each buffer lies between two pages that nobody may touch, as
//! Electric Fence has it for `malloc`, so that a kernel which reads or writes outside of it ends the program there and then.
//!
//! Buffers end where the page behind them begins, up to the alignment of what is in them; with `GUARD=front` they begin where
//! the page before them ends. New ones are full of a value that is no number, so that kernels do not find zeros by luck.
//! Drivers take memory of the host in place there (PoCL does); buffers that the caller keeps memory for stay where they are.
#![cfg(unix)]
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::ptr::null_mut;
use std::sync::OnceLock;

/// `CL_MEM_USE_HOST_PTR`, `CL_MEM_ALLOC_HOST_PTR`, `CL_MEM_COPY_HOST_PTR`.
const USE_HOST: u64 = 1 << 3;
const ALLOC_HOST: u64 = 1 << 4;
const COPY_HOST: u64 = 1 << 5;
/// Places in the loader's table of functions (`cl_icd_dispatch` in CL/cl_icd.h).
const CREATE_BUFFER: usize = 14;
const ON_DESTROY: usize = 83;
/// OpenCL's largest type.
const MOST_ALIGNMENT: usize = 128;
/// Bits of a float that is no number.
const FILL: u8 = 0xff;

/// What it says on standard error when it begins.
pub const ON: &str = "guarded_buffers: each buffer lies between pages that nobody may touch";

type CreateBuffer = unsafe extern "C" fn(*mut c_void, u64, usize, *mut c_void, *mut i32) -> *mut c_void;
type Destroyed = unsafe extern "C" fn(*mut c_void, *mut c_void);
type OnDestroy = unsafe extern "C" fn(*mut c_void, Destroyed, *mut c_void) -> i32;

/// The driver's functions, and the table with this layer's, null where the driver's serve.
struct Layer {
    create: CreateBuffer,
    on_destroy: OnDestroy,
    table: Vec<usize>,
}

static LAYER: OnceLock<Layer> = OnceLock::new();

/// Pages with two that nobody may touch.
struct Guarded {
    start: *mut c_void,
    length: usize,
}

impl Guarded {
    /// Memory for so many bytes, and where they begin.
    fn new(bytes: usize) -> Option<(Guarded, *mut u8)> {
        // SAFETY: a question.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let inside = bytes.next_multiple_of(page);
        let length = inside + 2 * page;
        // SAFETY: new pages of nobody's, nowhere in particular.
        let start = unsafe {
            libc::mmap(null_mut(), length, libc::PROT_NONE, libc::MAP_PRIVATE | libc::MAP_ANONYMOUS, -1, 0)
        };
        if start == libc::MAP_FAILED {
            return None;
        }
        // SAFETY: inside of the pages that were just made.
        let first = unsafe { start.cast::<u8>().add(page) };
        // SAFETY: these are pages of the same, between the first and the last.
        if unsafe { libc::mprotect(first.cast(), inside, libc::PROT_READ | libc::PROT_WRITE) } != 0 {
            return None;
        }
        // A size is a multiple of its elements' alignment.
        let alignment = (1 << bytes.trailing_zeros().min(MOST_ALIGNMENT.ilog2())).min(MOST_ALIGNMENT);
        let at_front = std::env::var("GUARD").is_ok_and(|side| side == "front");
        let spare = if at_front { 0 } else { (inside - bytes) / alignment * alignment };
        // SAFETY: `spare + bytes` is at most `inside`.
        let data = unsafe { first.add(spare) };
        // SAFETY: as many bytes may be written there.
        unsafe { data.write_bytes(FILL, bytes) };
        Some((Guarded { start, length }, data))
    }
}

/// Gives a buffer's pages back.
unsafe extern "C" fn destroyed(_: *mut c_void, pages: *mut c_void) {
    // SAFETY: `create_buffer` gave it, for this one call.
    let pages = unsafe { Box::from_raw(pages.cast::<Guarded>()) };
    // SAFETY: they were mapped so, and the buffer that lay there is gone.
    unsafe { libc::munmap(pages.start, pages.length) };
}

unsafe extern "C" fn create_buffer(
    context: *mut c_void,
    flags: u64,
    bytes: usize,
    host: *mut c_void,
    error: *mut i32,
) -> *mut c_void {
    let Some(layer) = LAYER.get() else { return null_mut() };
    let guarded = if flags & USE_HOST != 0 || bytes == 0 { None } else { Guarded::new(bytes) };
    let Some((pages, data)) = guarded else {
        // SAFETY: the caller's arguments.
        return unsafe { (layer.create)(context, flags, bytes, host, error) };
    };
    if flags & COPY_HOST != 0 && !host.is_null() {
        // SAFETY: the caller has as many bytes there, and they are not these.
        unsafe { data.copy_from_nonoverlapping(host.cast(), bytes) };
    }
    let flags = flags & !(COPY_HOST | ALLOC_HOST) | USE_HOST;
    // SAFETY: the memory is there until the driver calls `destroyed`.
    let buffer = unsafe { (layer.create)(context, flags, bytes, data.cast(), error) };
    if !buffer.is_null() {
        // SAFETY: the buffer is valid, and what is given lives until then.
        unsafe { (layer.on_destroy)(buffer, destroyed, Box::into_raw(Box::new(pages)).cast()) };
    }
    buffer
}

/// Tells the loader which version of layers this is: 100, the only one.
///
/// # Safety
/// As OpenCL has it: `value` has room for `size` bytes or is null, and so has `told` for a size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn clGetLayerInfo(name: u32, size: usize, value: *mut c_void, told: *mut usize) -> i32 {
    const API_VERSION: u32 = 0x4240;
    const INVALID_VALUE: i32 = -30;
    if name != API_VERSION || (!value.is_null() && size < size_of::<u32>()) {
        return INVALID_VALUE;
    }
    if !value.is_null() {
        // SAFETY: there is room.
        unsafe { value.cast::<u32>().write(100) };
    }
    if !told.is_null() {
        // SAFETY: the caller gave it.
        unsafe { told.write(size_of::<u32>()) };
    }
    0
}

/// Takes the functions of what is below, and gives this layer's.
///
/// # Safety
/// As the loader calls it: `below` has `count` functions, the pointers are valid, and it is called once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn clInitLayer(
    count: u32,
    below: *const usize,
    given: *mut u32,
    functions: *mut *const usize,
) -> i32 {
    const INVALID_VALUE: i32 = -30;
    if (count as usize) <= ON_DESTROY || below.is_null() || given.is_null() || functions.is_null() {
        return INVALID_VALUE;
    }
    // SAFETY: the table has both, which are functions of these types.
    let (create, on_destroy) = unsafe {
        (
            std::mem::transmute::<usize, CreateBuffer>(*below.add(CREATE_BUFFER)),
            std::mem::transmute::<usize, OnDestroy>(*below.add(ON_DESTROY)),
        )
    };
    let mut table = vec![0; count as usize];
    table[CREATE_BUFFER] = create_buffer as CreateBuffer as usize;
    let layer = LAYER.get_or_init(|| Layer { create, on_destroy, table });
    // SAFETY: the loader's own places; the table lives as long as the program.
    unsafe {
        given.write(count);
        functions.write(layer.table.as_ptr());
    }
    // Loaders that take no layers ignore the variable that names them.
    eprintln!("{ON}");
    0
}
