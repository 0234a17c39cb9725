//! The only place that calls OpenImageIO: handles with owners, slices with checked lengths, messages as strings.
#![allow(unsafe_code)]

#[cfg(test)]
pub(super) mod raw;

use std::ffi::{CStr, CString, OsStr, c_char, c_void};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::ptr::{self, NonNull};
use std::sync::{Arc, Once};

use half::f16;
use mapped::prefer_large_pages;
use openimageio_sys as sys;

use super::picture::{Attribute, ChannelFormat};

/// OpenImageIO's version, `2.4.7.1`.
pub fn version() -> String {
    let mut text = [0; 64];
    // SAFETY: the buffer is ours and its size is passed; the callee ends the text with a zero.
    unsafe { sys::oiio_border_version(text.as_mut_ptr(), text.len()) };
    text_of(&text)
}

/// Why a call failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Refusal {
    pub(super) kind: Kind,
    /// OpenImageIO's or the system's words.
    pub(super) message: String,
}

/// What kind of failure it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// No reader knows the format, or the reader refuses the header.
    CannotOpen,
    /// No flat picture with pixels.
    BadImage,
    /// More bytes than allowed.
    TooLarge,
    /// Cut off or damaged.
    CannotRead,
    /// The file could not be made, or not written to its end.
    CannotWrite,
    /// No such part, channel or attribute.
    Absent,
    /// The system has no more memory.
    NoMemory,
    /// A bug of ours.
    Misuse,
}

/// How the pixels of an opened image are stored best.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Byte,
    Half,
    Float,
}

/// The header of one part.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Info {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Of the data window.
    pub(super) origin: [i32; 2],
    /// The display window.
    pub(super) full_size: [u32; 2],
    pub(super) full_origin: [i32; 2],
    pub(super) channels: u32,
    pub(super) format: Format,
    pub(super) alpha_channel: Option<u32>,
    pub(super) depth_channel: Option<u32>,
    /// OpenImageIO's `oiio:ColorSpace`; empty if the file says nothing.
    pub(super) color_space: String,
}

/// Pixels, interleaved, row 0 on top.
#[derive(Debug, Clone)]
pub(super) enum Pixels {
    Byte(Vec<u8>),
    Half(Vec<f16>),
    Float(Vec<f32>),
}

/// An opened image.
pub(super) struct Input {
    handle: NonNull<sys::OiioBorderInput>,
    /// What the handle reads from, if not from a file.
    _bytes: Option<Arc<[u8]>>,
}

impl Input {
    /// Opens a file; or `bytes`, with `name` to tell the format by.
    pub(super) fn open(name: &OsStr, bytes: Option<Arc<[u8]>>) -> Result<Self, Refusal> {
        declare_formats();
        let name = c_string(name.as_bytes())?;
        let (data, size) = match &bytes {
            Some(bytes) => (bytes.as_ptr(), bytes.len()),
            None => (ptr::null(), 0),
        };
        let mut handle = ptr::null_mut();
        call(|message, message_size| {
            // SAFETY: the name ends with a zero; `data` has `size` bytes that live as long as the handle, because
            // `Self` owns both and the bytes behind an `Arc` neither move nor change; the rest are our buffers.
            unsafe {
                sys::oiio_border_open(
                    name.as_ptr(),
                    data,
                    size,
                    &mut handle,
                    message,
                    message_size,
                )
            }
        })?;
        Ok(Self {
            handle: NonNull::new(handle).ok_or_else(|| misuse("no handle"))?,
            _bytes: bytes,
        })
    }

    /// The header of a part.
    pub(super) fn info(&mut self, part: u32) -> Result<Info, Refusal> {
        self.level_info(part, 0)
    }

    /// Width and height of a MIP level of a part; `None`: there is no such level, or no such part.
    pub(super) fn level_size(
        &mut self,
        part: u32,
        level: u32,
    ) -> Result<Option<[u32; 2]>, Refusal> {
        match self.level_info(part, level) {
            Ok(info) => Ok(Some([info.width, info.height])),
            Err(refusal) if refusal.kind == Kind::Absent => Ok(None),
            Err(refusal) => Err(refusal),
        }
    }

    /// The header of a MIP level of a part.
    fn level_info(&mut self, part: u32, level: u32) -> Result<Info, Refusal> {
        let mut info = sys::OiioBorderInfo::default();
        call(|message, message_size| {
            // SAFETY: the handle is alive until `drop`, and `&mut self` makes us its only user.
            unsafe {
                sys::oiio_border_info(
                    self.handle.as_ptr(),
                    part,
                    level,
                    &mut info,
                    message,
                    message_size,
                )
            }
        })?;
        Ok(Info {
            width: info.width,
            height: info.height,
            origin: [info.x, info.y],
            full_size: [info.full_width, info.full_height],
            full_origin: [info.full_x, info.full_y],
            channels: info.channels,
            format: match info.format {
                sys::OIIO_BORDER_UINT8 => Format::Byte,
                sys::OIIO_BORDER_HALF => Format::Half,
                _ => Format::Float,
            },
            alpha_channel: u32::try_from(info.alpha_channel).ok(),
            depth_channel: u32::try_from(info.depth_channel).ok(),
            color_space: text_of(&info.color_space),
        })
    }

    /// The first `channels` channels of a MIP level of a part, if they take at most `limit` bytes.
    pub(super) fn read(
        &mut self,
        [part, level]: [u32; 2],
        channels: u32,
        format: Format,
        limit: usize,
    ) -> Result<Pixels, Refusal> {
        let info = self.level_info(part, level)?;
        let count = u64::from(info.width) * u64::from(info.height);
        let bytes_each = match format {
            Format::Byte => 1,
            Format::Half => 2,
            Format::Float => 4,
        };
        let count = usize::try_from(count)
            .ok()
            .and_then(|count| count.checked_mul(channels as usize))
            .filter(|count| *count <= limit / bytes_each)
            .ok_or_else(|| Refusal {
                kind: Kind::TooLarge,
                message: format!(
                    "{} × {} texels of {channels} channels take more than {limit} bytes",
                    info.width, info.height
                ),
            })?;
        Ok(match format {
            Format::Byte => Pixels::Byte(self.fill(
                [part, level],
                channels,
                sys::OIIO_BORDER_UINT8,
                limit,
                zeros(count, 0_u8),
            )?),
            Format::Half => Pixels::Half(self.fill(
                [part, level],
                channels,
                sys::OIIO_BORDER_HALF,
                limit,
                zeros(count, f16::ZERO),
            )?),
            Format::Float => Pixels::Float(self.fill(
                [part, level],
                channels,
                sys::OIIO_BORDER_FLOAT,
                limit,
                zeros(count, 0_f32),
            )?),
        })
    }

    /// Reads a level of a part into `pixels`; `T` is a plain number of the size that `format` has.
    fn fill<T: Copy>(
        &mut self,
        [part, level]: [u32; 2],
        channels: u32,
        format: u32,
        limit: usize,
        mut pixels: Vec<T>,
    ) -> Result<Vec<T>, Refusal> {
        let size = size_of_val(pixels.as_slice());
        call(|message, message_size| {
            // SAFETY: the handle is alive and ours alone; `pixels` is initialised and has `size` bytes, of which
            // the callee makes sure that they are exactly what it writes; any bits are a valid whole number, f16 or f32.
            unsafe {
                sys::oiio_border_read(
                    self.handle.as_ptr(),
                    part,
                    level,
                    channels,
                    format,
                    pixels.as_mut_ptr().cast(),
                    size,
                    limit,
                    message,
                    message_size,
                )
            }
        })?;
        Ok(pixels)
    }
}

/// So many zeros, in large pages where they are many: textures are looked up here and there.
fn zeros<T: Clone>(count: usize, zero: T) -> Vec<T> {
    let mut pixels = Vec::with_capacity(count);
    prefer_large_pages(pixels.spare_capacity_mut());
    pixels.resize(count, zero);
    pixels
}

impl Drop for Input {
    fn drop(&mut self) {
        // SAFETY: the handle came from `oiio_border_open` and is freed here only.
        unsafe { sys::oiio_border_close(self.handle.as_ptr()) };
    }
}

/// The file formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FileFormat {
    OpenExr,
    Png,
}

/// A channel's name and format.
type NamedFormat<'a> = (&'a str, Option<ChannelFormat>);

/// What [`Output::create`] needs to know of a picture.
pub(super) struct Header<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) display_window: (u32, u32, i32, i32),
    pub(super) tile: u32,
    pub(super) compression: Option<&'a str>,
    /// Name, and name and format of the channels; a channel without format has bytes.
    pub(super) parts: Vec<(&'a str, Vec<NamedFormat<'a>>)>,
    pub(super) metadata: &'a [(String, Attribute)],
}

/// A file that is being written.
pub(super) struct Output {
    /// `None` once finished.
    handle: Option<NonNull<sys::OiioBorderOutput>>,
}

impl Output {
    /// Makes (or empties) the file.
    pub(super) fn create(
        path: &Path,
        format: FileFormat,
        header: &Header<'_>,
    ) -> Result<Self, Refusal> {
        declare_formats();
        // All strings with their zeros first: the structures below point into these vectors, which are complete
        // before the first pointer is taken.
        let path = c_string(path.as_os_str().as_bytes())?;
        let format = match format {
            FileFormat::OpenExr => c"openexr",
            FileFormat::Png => c"png",
        };
        let compression = header.compression.map(text_c_string);
        let mut names = Vec::new();
        for (name, channels) in &header.parts {
            let channels: Vec<_> = channels
                .iter()
                .map(|(name, format)| (text_c_string(name), *format))
                .collect();
            names.push((text_c_string(name), channels));
        }
        let texts: Vec<_> = header
            .metadata
            .iter()
            .map(|(name, value)| {
                let text = match value {
                    Attribute::Text(text) => Some(text_c_string(text)),
                    _ => None,
                };
                (text_c_string(name), text)
            })
            .collect();

        // Then the structures, innermost first.
        let channels: Vec<Vec<_>> = names
            .iter()
            .map(|(_, channels)| {
                channels
                    .iter()
                    .map(|(name, format)| sys::OiioBorderChannel {
                        name: name.as_ptr(),
                        format: match format {
                            None => sys::OIIO_BORDER_UINT8,
                            Some(ChannelFormat::Half) => sys::OIIO_BORDER_HALF,
                            Some(ChannelFormat::Float) => sys::OIIO_BORDER_FLOAT,
                            Some(ChannelFormat::Uint) => sys::OIIO_BORDER_UINT32,
                        },
                    })
                    .collect()
            })
            .collect();
        let parts: Vec<_> = names
            .iter()
            .zip(&channels)
            .map(|((name, _), channels)| sys::OiioBorderPart {
                name: name.as_ptr(),
                channels: channels.as_ptr(),
                channel_count: channels.len(),
            })
            .collect();
        let attributes: Vec<_> = header
            .metadata
            .iter()
            .zip(&texts)
            .map(|((_, value), (name, text))| attribute(value, name, text.as_deref()))
            .collect();
        let (full_width, full_height, x, y) = header.display_window;
        let picture = sys::OiioBorderPicture {
            width: header.width,
            height: header.height,
            x,
            y,
            full_width,
            full_height,
            tile: header.tile,
            compression: compression.as_deref().map_or(ptr::null(), CStr::as_ptr),
            parts: parts.as_ptr(),
            part_count: parts.len(),
            attributes: attributes.as_ptr(),
            attribute_count: attributes.len(),
        };

        let mut handle = ptr::null_mut();
        call(|message, message_size| {
            // SAFETY: every pointer of `picture` points into `names`, `texts`, `channels`, `parts`, `attributes`
            // or `compression`, which live to the end of this function; the callee copies what it keeps.
            unsafe {
                sys::oiio_border_create(
                    path.as_ptr(),
                    format.as_ptr(),
                    &picture,
                    &mut handle,
                    message,
                    message_size,
                )
            }
        })?;
        Ok(Self {
            handle: Some(NonNull::new(handle).ok_or_else(|| misuse("no handle"))?),
        })
    }

    /// The next rows, packed.
    pub(super) fn write(&mut self, rows: u32, packed: &[u8]) -> Result<(), Refusal> {
        let handle = self.handle.ok_or_else(|| misuse("already finished"))?;
        call(|message, message_size| {
            // SAFETY: the handle is alive and ours alone; the callee checks that `packed` is exactly what it reads.
            unsafe {
                sys::oiio_border_write(
                    handle.as_ptr(),
                    rows,
                    packed.as_ptr().cast(),
                    packed.len(),
                    message,
                    message_size,
                )
            }
        })
    }

    /// Ends the file; only after this is it whole.
    pub(super) fn finish(mut self) -> Result<(), Refusal> {
        let handle = self
            .handle
            .take()
            .ok_or_else(|| misuse("already finished"))?;
        call(|message, message_size| {
            // SAFETY: the handle is alive; the callee frees it in any case, and `take` leaves none behind.
            unsafe { sys::oiio_border_finish(handle.as_ptr(), message, message_size) }
        })
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some(handle) = self.handle.take() {
            // SAFETY: the handle came from `oiio_border_create` and `finish` has not freed it.
            unsafe { sys::oiio_border_abandon(handle.as_ptr()) };
        }
    }
}

fn attribute(value: &Attribute, name: &CStr, text: Option<&CStr>) -> sys::OiioBorderAttribute {
    let mut out = sys::OiioBorderAttribute {
        name: name.as_ptr(),
        text: text.map_or(ptr::null(), CStr::as_ptr),
        ..Default::default()
    };
    match value {
        Attribute::Int(integer) => {
            out.kind = sys::OIIO_BORDER_INT;
            out.integer = *integer;
        }
        Attribute::Float(real) => {
            out.kind = sys::OIIO_BORDER_REAL;
            out.real[0] = *real;
        }
        Attribute::Text(_) => out.kind = sys::OIIO_BORDER_TEXT,
        Attribute::Matrix(matrix) => {
            out.kind = sys::OIIO_BORDER_MATRIX;
            out.real = *matrix;
        }
    }
    out
}

/// Makes our reader the one for Ptex, before OpenImageIO's for raw photographs claims the ending `.ptx`: what it does at
/// its first use, whatever that is.
fn declare_formats() {
    // OpenImageIO's registry is the process's, and has to be told once, by one thread.
    static DECLARED: Once = Once::new();
    DECLARED.call_once(|| {
        let declared = call(|message, message_size| {
            // SAFETY: the strings are constants, the list of them ends with a null; the function makes an
            // `OIIO::ImageInput`, or null; the buffer is ours. No other thread of ours is in OpenImageIO: all come
            // through here first.
            unsafe {
                sys::oiio_border_declare(
                    ptex_oiio::NAME.as_ptr(),
                    ptex_oiio::EXTENSIONS.as_ptr(),
                    ptex_oiio::ptex_imageio_library_version(),
                    Some(new_ptex_input),
                    message,
                    message_size,
                )
            }
        });
        // Only memory can be lacking. Then `.ptx` files cannot be opened, which will be told.
        debug_assert_eq!(declared, Ok(()));
    });
}

unsafe extern "C" fn new_ptex_input() -> *mut c_void {
    ptex_oiio::ptex_input_imageio_create()
}

/// Calls with a buffer for the message, and makes a `Result` of the code.
fn call<C: TryInto<u32>>(f: impl FnOnce(*mut c_char, usize) -> C) -> Result<(), Refusal> {
    // Long enough for a path and OpenImageIO's sentence; longer ones are cut.
    let mut message = [0; 4096];
    let code = f(message.as_mut_ptr(), message.len())
        .try_into()
        .unwrap_or(u32::MAX);
    let kind = match code {
        sys::OIIO_BORDER_OK => return Ok(()),
        sys::OIIO_BORDER_CANNOT_OPEN => Kind::CannotOpen,
        sys::OIIO_BORDER_BAD_IMAGE => Kind::BadImage,
        sys::OIIO_BORDER_TOO_LARGE => Kind::TooLarge,
        sys::OIIO_BORDER_CANNOT_READ => Kind::CannotRead,
        sys::OIIO_BORDER_CANNOT_WRITE => Kind::CannotWrite,
        sys::OIIO_BORDER_ABSENT => Kind::Absent,
        sys::OIIO_BORDER_NO_MEMORY => Kind::NoMemory,
        _ => Kind::Misuse,
    };
    Err(Refusal {
        kind,
        message: text_of(&message),
    })
}

/// The text up to the first zero.
fn text_of(buffer: &[c_char]) -> String {
    let bytes: Vec<u8> = buffer
        .iter()
        .map(|c| c.to_ne_bytes()[0])
        .take_while(|byte| *byte != 0)
        .collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn c_string(bytes: &[u8]) -> Result<CString, Refusal> {
    CString::new(bytes).map_err(|_| Refusal {
        kind: Kind::CannotOpen,
        message: "the name holds a zero byte".into(),
    })
}

/// Text that ends at its first zero byte.
fn text_c_string(text: &str) -> CString {
    let text = text.split('\0').next().unwrap_or_default();
    CString::new(text).expect("split at the zero bytes")
}

fn misuse(message: &str) -> Refusal {
    Refusal {
        kind: Kind::Misuse,
        message: message.into(),
    }
}
