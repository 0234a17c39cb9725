//! Embree 4's C API, on Embree 4 or (by a small C layer) on Embree 3.13.
#![allow(
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    clippy::all
)]
include!(concat!(env!("OUT_DIR"), "/bindings.rs"));

/// Embree's inline functions, which have no symbol to link.
pub fn rtcInitIntersectArguments() -> RTCIntersectArguments {
    RTCIntersectArguments {
        feature_mask: RTC_FEATURE_FLAG_ALL,
        ..unsafe { core::mem::zeroed() }
    }
}
pub fn rtcInitOccludedArguments() -> RTCOccludedArguments {
    RTCOccludedArguments {
        feature_mask: RTC_FEATURE_FLAG_ALL,
        ..unsafe { core::mem::zeroed() }
    }
}
pub fn rtcInitRayQueryContext() -> RTCRayQueryContext {
    let mut c: RTCRayQueryContext = unsafe { core::mem::zeroed() };
    c.instID = [INVALID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    #[cfg(not(embree3))]
    {
        c.instPrimID = [INVALID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    }
    c
}
pub fn rtcInitPointQueryContext() -> RTCPointQueryContext {
    let mut c: RTCPointQueryContext = unsafe { core::mem::zeroed() };
    c.instID = [INVALID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    #[cfg(not(embree3))]
    {
        c.instPrimID = [INVALID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize];
    }
    c
}
const INVALID: u32 = u32::MAX;
