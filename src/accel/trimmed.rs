//! Any method on a trimmed surface: hits where the surface is cut away are passed over.
//!
//! What is cut away is decided by the parameters of each hit, so that borders are as exact as the trim curves,
//! however coarse the method's own geometry is.

use std::sync::Arc;

use super::{Hit, Intersector};
use crate::math::{Bounds3, Ray};
use crate::surface::Surface;

/// A method on the kept part of a surface.
pub struct Trimmed<I> {
    inner: I,
    surface: Arc<Surface>,
}

impl<I: Intersector> Trimmed<I> {
    /// Of a method that traces all of `surface`.
    pub fn new(inner: I, surface: Arc<Surface>) -> Self {
        Self { inner, surface }
    }
}

impl<I: Intersector> Intersector for Trimmed<I> {
    fn primitives(&self) -> u32 {
        self.inner.primitives()
    }

    fn keys(&self) -> u32 {
        self.inner.keys()
    }

    fn bounds(&self, p: u32, key: u32) -> Bounds3 {
        self.inner.bounds(p, key)
    }

    fn intersect(&self, p: u32, ray: &Ray) -> Option<Hit> {
        let mut ray = *ray;
        loop {
            let hit = self.inner.intersect(p, &ray)?;
            if self.surface.base().is_kept(hit.face, hit.uv) {
                return Some(hit);
            }
            ray.t_min = hit.t;
        }
    }

    fn memory(&self) -> usize {
        self.inner.memory()
    }
}
