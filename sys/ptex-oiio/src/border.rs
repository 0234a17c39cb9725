//! `c/ptex_border.h`, implemented: handles are boxes, errors and panics are messages.

use std::any::Any;
use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
use std::os::unix::ffi::OsStrExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;
use std::slice;

use relievo_ptex::{BorderMode, Cache, DataType, Error, MeshType, MetaValue, Reader, Res};

use crate::sys::{self, PtexBorderFile, PtexBorderInfo, PtexBorderMeta, PtexBorderSize};

/// Bytes of texels that a file may hold. OpenImageIO's caches hold what they were given themselves: this is for the
/// reductions that others are computed from.
const BUDGET: usize = 32 << 20;

/// What a handle points to.
struct File {
    reader: Reader,
    /// Points into `reader`.
    meta: Vec<PtexBorderMeta>,
}

/// Why a call failed.
struct Failure {
    code: u32,
    message: String,
}

impl Failure {
    fn absent(message: String) -> Self {
        let code = sys::PTEX_BORDER_ABSENT;
        Self { code, message }
    }

    fn misuse(message: &str) -> Self {
        Self {
            code: sys::PTEX_BORDER_MISUSE,
            message: message.into(),
        }
    }
}

impl From<Error> for Failure {
    fn from(e: Error) -> Self {
        Self {
            code: sys::PTEX_BORDER_FAILED,
            message: e.to_string(),
        }
    }
}

/// See `ptex_border.h`.
///
/// # Safety
/// `name` ends with a zero; `bytes` is null or has `byte_count` bytes; `file` can be written to; `message` is null or
/// has `message_size` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ptex_border_open(
    name: *const c_char,
    bytes: *const u8,
    byte_count: usize,
    file: *mut *mut PtexBorderFile,
    message: *mut c_char,
    message_size: usize,
) -> c_int {
    guarded(message, message_size, || {
        if name.is_null() || file.is_null() {
            return Err(Failure::misuse("null pointer"));
        }
        // SAFETY: the caller ends the name with a zero.
        let name = OsStr::from_bytes(unsafe { CStr::from_ptr(name) }.to_bytes());
        let cache = Cache::new(BUDGET);
        let reader = if bytes.is_null() {
            Reader::open(name, &cache)?
        } else {
            // SAFETY: the caller has that many bytes there.
            let bytes = unsafe { slice::from_raw_parts(bytes, byte_count) };
            Reader::from_bytes(bytes.to_vec(), name, &cache)?
        };
        let meta = reader.meta()?.iter().map(entry).collect();
        let opened = Box::into_raw(Box::new(File { reader, meta }));
        // SAFETY: the caller has room for a pointer there.
        unsafe { file.write(opened.cast()) };
        Ok(())
    })
}

/// See `ptex_border.h`.
///
/// # Safety
/// `file` is null, or came from [`ptex_border_open`] and no one else uses it.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ptex_border_close(file: *mut PtexBorderFile) {
    guarded(ptr::null_mut(), 0, || {
        if !file.is_null() {
            // SAFETY: `ptex_border_open` made it of a box, and it is given back once.
            drop(unsafe { Box::from_raw(file.cast::<File>()) });
        }
        Ok(())
    });
}

/// See `ptex_border.h`.
///
/// # Safety
/// `file` is open; `info` can be written to; `message` is null or has `message_size` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ptex_border_info(
    file: *const PtexBorderFile,
    info: *mut PtexBorderInfo,
    message: *mut c_char,
    message_size: usize,
) -> c_int {
    guarded(message, message_size, || {
        // SAFETY: the caller says that it is open.
        let File { reader, meta } = unsafe { file_of(file)? };
        let (u_border, v_border) = reader.border_modes();
        let found = PtexBorderInfo {
            type_: match reader.data_type() {
                DataType::U8 => sys::PTEX_BORDER_UINT8,
                DataType::U16 => sys::PTEX_BORDER_UINT16,
                DataType::F16 => sys::PTEX_BORDER_HALF,
                DataType::F32 => sys::PTEX_BORDER_FLOAT,
            },
            // The format has 16 bits for it.
            channels: reader.channels() as u32,
            alpha_channel: reader.alpha_channel().map_or(-1, |alpha| alpha as i32),
            faces: reader.face_count(),
            has_edits: reader.has_edits().into(),
            mesh_type: match reader.mesh_type() {
                MeshType::Quad => c"quad",
                MeshType::Triangle => c"triangle",
            }
            .as_ptr(),
            u_border: border(u_border).as_ptr(),
            v_border: border(v_border).as_ptr(),
            meta: meta.as_ptr(),
            meta_count: meta.len(),
        };
        write(info, found)
    })
}

/// See `ptex_border.h`.
///
/// # Safety
/// `file` is open; `size` can be written to; `message` is null or has `message_size` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ptex_border_size(
    file: *const PtexBorderFile,
    face: u32,
    level: u32,
    size: *mut PtexBorderSize,
    message: *mut c_char,
    message_size: usize,
) -> c_int {
    guarded(message, message_size, || {
        // SAFETY: the caller says that it is open.
        let File { reader, .. } = unsafe { file_of(file)? };
        let res = res_at(reader, face, level)?;
        // Damage is told when the texels are read; until then the face is there, and so are those behind it.
        let tile = reader.tile_res(face, res).ok().flatten().unwrap_or(res);
        let found = PtexBorderSize {
            width: 1 << res.ulog2,
            height: 1 << res.vlog2,
            tile_width: 1 << tile.ulog2,
            tile_height: 1 << tile.vlog2,
        };
        write(size, found)
    })
}

/// See `ptex_border.h`.
///
/// # Safety
/// `file` is open; `pixels` has `byte_count` bytes; `message` is null or has `message_size` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn ptex_border_read(
    file: *const PtexBorderFile,
    face: u32,
    level: u32,
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    pixels: *mut c_void,
    byte_count: usize,
    message: *mut c_char,
    message_size: usize,
) -> c_int {
    guarded(message, message_size, || {
        // SAFETY: the caller says that it is open.
        let File { reader, .. } = unsafe { file_of(file)? };
        let res = res_at(reader, face, level)?;
        let within = |from: u32, count: u32, log2: i8| {
            count > 0 && from.checked_add(count).is_some_and(|to| to <= 1 << log2)
        };
        if pixels.is_null() || !within(x, width, res.ulog2) || !within(y, height, res.vlog2) {
            return Err(Failure::misuse(&format!(
                "face {face}, level {level} has no {width} x {height} texels at {x}, {y}"
            )));
        }
        // Sides are at most 2^20 and texels at most 2^18 bytes.
        let texels = u64::from(width) * u64::from(height);
        let sample = reader.data_type().bytes();
        let bytes = texels * (reader.channels() * sample) as u64;
        if bytes != byte_count as u64 {
            return Err(Failure::misuse("the buffer has another size"));
        }
        let mut copied = Vec::with_capacity(byte_count);
        let [x, y, width, height] = [x, y, width, height].map(|n| n as usize);
        reader
            .texels(face, res, true)?
            .copy(x, y, width, height, &mut copied)?;
        if cfg!(target_endian = "big") {
            copied.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        assert_eq!(copied.len(), byte_count, "texels were copied");
        // SAFETY: both have that many bytes, and what was just allocated is not the caller's.
        unsafe { ptr::copy_nonoverlapping(copied.as_ptr(), pixels.cast(), byte_count) };
        Ok(())
    })
}

/// The size of a face's level.
fn res_at(reader: &Reader, face: u32, level: u32) -> Result<Res, Failure> {
    if face >= reader.face_count() {
        return Err(Failure::absent(format!(
            "{}: there is no face {face}, the file has {}",
            reader.path().display(),
            reader.face_count()
        )));
    }
    let Res { ulog2, vlog2 } = reader.face(face).res;
    let absent = || {
        Failure::absent(format!(
            "{}: face {face} has no level {level}: it has {} x {} texels",
            reader.path().display(),
            1_u32 << ulog2,
            1_u32 << vlog2
        ))
    };
    let level = i8::try_from(level)
        .ok()
        .filter(|level| *level <= ulog2.max(vlog2))
        .ok_or_else(absent)?;
    Ok(Res {
        ulog2: (ulog2 - level).max(0),
        vlog2: (vlog2 - level).max(0),
    })
}

fn border(mode: BorderMode) -> &'static CStr {
    match mode {
        BorderMode::Clamp => c"clamp",
        BorderMode::Black => c"black",
        BorderMode::Periodic => c"periodic",
    }
}

fn entry((key, value): (&str, &MetaValue)) -> PtexBorderMeta {
    let (type_, count, data): (_, _, *const c_void) = match value {
        MetaValue::String(s) => (sys::PTEX_BORDER_TEXT, s.len(), s.as_ptr().cast()),
        MetaValue::I8(v) => (sys::PTEX_BORDER_INT8, v.len(), v.as_ptr().cast()),
        MetaValue::I16(v) => (sys::PTEX_BORDER_INT16, v.len(), v.as_ptr().cast()),
        MetaValue::I32(v) => (sys::PTEX_BORDER_INT32, v.len(), v.as_ptr().cast()),
        MetaValue::F32(v) => (sys::PTEX_BORDER_FLOAT, v.len(), v.as_ptr().cast()),
        MetaValue::F64(v) => (sys::PTEX_BORDER_DOUBLE, v.len(), v.as_ptr().cast()),
    };
    PtexBorderMeta {
        key: key.as_ptr().cast(),
        key_size: key.len(),
        type_,
        count,
        data,
    }
}

/// The file behind a handle.
///
/// # Safety
/// `file` is null, or came from [`ptex_border_open`] and stays open for `'a`.
unsafe fn file_of<'a>(file: *const PtexBorderFile) -> Result<&'a File, Failure> {
    // SAFETY: it is a box of a `File`, of which there are shared references only until it is closed.
    unsafe { file.cast::<File>().as_ref() }.ok_or_else(|| Failure::misuse("null pointer"))
}

/// Hands out a value.
fn write<T>(to: *mut T, value: T) -> Result<(), Failure> {
    if to.is_null() {
        return Err(Failure::misuse("null pointer"));
    }
    // SAFETY: the caller of the border has room for a value there.
    unsafe { to.write(value) };
    Ok(())
}

/// Runs a body; makes a code, and a message in the caller's buffer, of its error or panic.
fn guarded(
    message: *mut c_char,
    message_size: usize,
    body: impl FnOnce() -> Result<(), Failure>,
) -> c_int {
    // What a body looks at is not changed by it, but for the reader's cache, which is made for threads that panic.
    let failure = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => return sys::PTEX_BORDER_OK as c_int,
        Ok(Err(failure)) => failure,
        Err(panic) => Failure {
            code: sys::PTEX_BORDER_FAILED,
            message: format!("a bug of the reader: {}", told(&*panic)),
        },
    };
    if !message.is_null() && message_size > 0 {
        let length = failure.message.len().min(message_size - 1);
        // SAFETY: the caller has `message_size` bytes there, and they are no part of our string.
        unsafe {
            ptr::copy_nonoverlapping(failure.message.as_ptr(), message.cast(), length);
            message.add(length).write(0);
        }
    }
    failure.code as c_int
}

fn told(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("it panicked")
}

/// Compiles if the header declares what is defined here: elements of an array have one type.
const _: fn() = || {
    let _ = [sys::ptex_border_open, ptex_border_open];
    let _ = [sys::ptex_border_close, ptex_border_close];
    let _ = [sys::ptex_border_info, ptex_border_info];
    let _ = [sys::ptex_border_size, ptex_border_size];
    let _ = [sys::ptex_border_read, ptex_border_read];
};

#[cfg(test)]
mod tests;
