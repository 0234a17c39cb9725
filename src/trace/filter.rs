//! Hits that do not count: Embree's filter callbacks.
#![allow(unsafe_code)]

use std::sync::Arc;

use embree4_sys as sys;

use super::geometry::Geometry;
use super::panics::PanicSlot;
use crate::math::Vec2;

/// Whether a hit on a primitive at its parameters counts. Called on many threads at once.
pub type Filter = Arc<dyn Fn(u32, Vec2) -> bool + Send + Sync>;

/// What the callback borrows. Owned by the geometry, hence by the scene.
pub(super) struct Kept {
    filter: Filter,
    panics: Arc<PanicSlot>,
}

impl Geometry {
    /// Rays go on behind hits that `filter` says no to. For triangles and grids.
    pub fn filter(&mut self, filter: Filter) {
        let kept = Box::new(Kept {
            filter,
            panics: Arc::clone(&self.panics),
        });
        let pointer: *const Kept = &raw const *kept;
        // SAFETY: the geometry is alive and in no scene yet. The box stays where it is until the geometry is released
        // (field order in `Geometry`), and the callback only borrows it.
        unsafe {
            let raw = self.handle.raw();
            sys::rtcSetGeometryUserData(raw, pointer.cast_mut().cast());
            sys::rtcSetGeometryIntersectFilterFunction(raw, Some(refuse));
            sys::rtcSetGeometryOccludedFilterFunction(raw, Some(refuse));
        }
        self.kept = Some(kept);
    }
}

unsafe extern "C" fn refuse(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree's arguments are valid during the call, and its user pointer is the one set above.
    let (args, kept) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<Kept>()) };
    // Queries are single rays (scene.rs): a packet would be a bug that must not go on.
    assert_eq!(args.N, 1, "a packet of rays in a callback for single rays");
    // SAFETY: N is 1, so these are one number and one RTCHit, ours alone during the call.
    let (valid, hit) = unsafe { (&mut *args.valid, &*args.hit.cast::<sys::RTCHit>()) };
    if *valid != 0
        && !(kept.panics).guard(true, || (kept.filter)(hit.primID, Vec2::new(hit.u, hit.v)))
    {
        *valid = 0;
    }
}
