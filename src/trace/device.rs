//! Embree's device: its threads, its memory, its errors.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_void};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex};

use embree4_sys as sys;

use crate::error::{Error, Result};
use crate::memory::{Budget, amount, none_left};

/// How to make a [`Device`].
#[derive(Debug, Clone, Default)]
pub struct DeviceOptions {
    /// Threads that build scenes; 0 for one per processor.
    pub threads: usize,
    /// What the whole program may have in memory. Embree gets what is left of it: a build that needs more ends with
    /// [`Error::Memory`].
    pub memory_budget: Budget,
    /// Further settings in Embree's own words: `isa=avx2,hugepages=1`.
    pub config: String,
}

/// What everything else of this module is made with. Clones are the same device.
#[derive(Clone)]
pub struct Device(Arc<Inner>);

struct Inner {
    handle: sys::RTCDevice,
    /// Boxed, as Embree keeps its address; dropped after the device is released.
    monitor: Box<Monitor>,
}

struct Monitor {
    current: AtomicIsize,
    peak: AtomicIsize,
    /// What Embree may hold, as it was [settled](Device::settle) last.
    allowed: AtomicIsize,
    budget: Budget,
    message: Mutex<String>,
}

// SAFETY: Embree's devices are reference-counted with atomics and may be used from any thread; all mutable
// state on our side is atomic or behind a mutex.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

impl Device {
    /// A device of its own threads, memory count and errors.
    ///
    /// # Errors
    /// [`Error::Usage`] if Embree refuses the settings, [`Error::Memory`] if the system has no more for its threads.
    pub fn new(options: &DeviceOptions) -> Result<Self> {
        let mut config = String::new();
        if options.threads > 0 {
            write!(config, "threads={},", options.threads).expect("strings take all text");
        }
        config += &options.config;
        let refuse = || Error::usage("Embree refuses its settings", "check the device settings");
        let text = CString::new(config).map_err(|_| refuse())?;
        // SAFETY: the string is NUL-terminated and only read during the call.
        let handle = unsafe { sys::rtcNewDevice(text.as_ptr()) };
        if handle.is_null() {
            // SAFETY: without a device it tells why this thread got none.
            let code = unsafe { sys::rtcGetDeviceError(std::ptr::null_mut()) };
            // Threads that cannot be started are of unknown kind to it.
            return Err(match code {
                sys::RTC_ERROR_OUT_OF_MEMORY | sys::RTC_ERROR_UNKNOWN => {
                    none_left("Embree does not start")
                }
                _ => refuse(),
            });
        }
        let monitor = Box::new(Monitor {
            current: AtomicIsize::new(0),
            peak: AtomicIsize::new(0),
            allowed: AtomicIsize::new(isize::MAX),
            budget: options.memory_budget.clone(),
            message: Mutex::default(),
        });
        let user: *const Monitor = &raw const *monitor;
        // SAFETY: the monitor stays at its address until after the device is released (`Drop` below); the
        // callbacks only read it, through shared references.
        unsafe {
            sys::rtcSetDeviceErrorFunction(handle, Some(on_error), user.cast_mut().cast());
            sys::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), user.cast_mut().cast());
        }
        Ok(Self(Arc::new(Inner { handle, monitor })))
    }

    /// Bytes that Embree holds now.
    pub fn memory(&self) -> usize {
        let bytes = self.0.monitor.current.load(Ordering::Relaxed);
        usize::try_from(bytes).unwrap_or(0)
    }

    /// What the whole program may have in memory.
    pub fn memory_budget(&self) -> &Budget {
        &self.0.monitor.budget
    }

    /// Measures how much Embree may take from now on. What it holds now must have been written to: until the next time
    /// all that is taken should be Embree's.
    pub(super) fn settle(&self) {
        let monitor = &self.0.monitor;
        if let Some(left) = monitor.budget.left() {
            let left = isize::try_from(left).unwrap_or(isize::MAX);
            let held = monitor.current.load(Ordering::Relaxed);
            monitor
                .allowed
                .store(held.saturating_add(left), Ordering::Relaxed);
        }
    }

    /// The most bytes that Embree held at once.
    pub fn peak_memory(&self) -> usize {
        let bytes = self.0.monitor.peak.load(Ordering::Relaxed);
        usize::try_from(bytes).unwrap_or(0)
    }

    /// The version of the Embree library in use, as `3.13.5`.
    pub fn version(&self) -> String {
        let of = |property| {
            // SAFETY: the device lives as long as `self`.
            unsafe { sys::rtcGetDeviceProperty(self.handle(), property) }
        };
        format!(
            "{}.{}.{}",
            of(sys::RTC_DEVICE_PROPERTY_VERSION_MAJOR),
            of(sys::RTC_DEVICE_PROPERTY_VERSION_MINOR),
            of(sys::RTC_DEVICE_PROPERTY_VERSION_PATCH)
        )
    }

    pub(super) fn handle(&self) -> sys::RTCDevice {
        self.0.handle
    }

    pub(super) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// The error that Embree noted on this thread since the last call.
    pub(super) fn check(&self) -> Result<()> {
        // SAFETY: the device lives as long as `self`.
        let code = unsafe { sys::rtcGetDeviceError(self.handle()) };
        if code == sys::RTC_ERROR_NONE {
            return Ok(());
        }
        let message = match self.0.monitor.message.lock() {
            Ok(mut text) => std::mem::take(&mut *text),
            Err(_) => String::new(),
        };
        Err(match code {
            sys::RTC_ERROR_CANCELLED => Error::Interrupted,
            sys::RTC_ERROR_OUT_OF_MEMORY => {
                let budget = &self.0.monitor.budget;
                let held = amount(self.memory() as f64);
                Error::Memory {
                    message: match budget.limit() {
                        None => format!("Embree found no more memory (it holds {held})"),
                        Some(limit) => format!(
                            "Embree needs more than what is left of the memory budget of {} (it holds {held})",
                            amount(limit as f64)
                        ),
                    },
                    help: Some(
                        "raise --memory-budget, dice more coarsely (--dicing-rate), or choose --method auto"
                            .to_owned(),
                    ),
                }
            }
            _ => Error::failed(format!("Embree: {message} (error {code})")),
        })
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: made by `rtcNewDevice`, released once. Whoever made something with the device holds an `Arc`
        // of it, so no callback comes after this, and the monitor is dropped after it.
        unsafe { sys::rtcReleaseDevice(self.handle) }
    }
}

unsafe extern "C" fn on_error(user: *mut c_void, _code: sys::RTCError, text: *const c_char) {
    // SAFETY: Embree hands back the monitor that `Device::new` set, which outlives the device.
    let monitor = unsafe { &*user.cast::<Monitor>() };
    if !text.is_null() {
        // SAFETY: Embree's messages are NUL-terminated.
        let text = unsafe { CStr::from_ptr(text) };
        if let Ok(mut message) = monitor.message.lock() {
            *message = text.to_string_lossy().into_owned();
        }
    }
}

unsafe extern "C" fn on_memory(user: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: as for `on_error`.
    let monitor = unsafe { &*user.cast::<Monitor>() };
    let now = monitor.current.fetch_add(bytes, Ordering::Relaxed) + bytes;
    let refused = |bytes: isize| {
        bytes > 0 && (now > monitor.allowed.load(Ordering::Relaxed) || !monitor.budget.grants())
    };
    if refused(bytes) {
        // Refused, so it never exists.
        monitor.current.fetch_sub(bytes, Ordering::Relaxed);
        return false;
    }
    monitor.peak.fetch_max(now, Ordering::Relaxed);
    true
}
