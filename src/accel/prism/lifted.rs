//! The lines through the corners of a surface's quads, of the same bits where faces meet.
//!
//! A limit surface is diced as it is and once more, moved along its normals by the object's size: the difference is the normal,
//! and where faces share a corner it is one for all of them, the mean of theirs, also along creases.

use std::sync::Arc;

use crate::math::{Bounds3, Vec3};
use crate::surface::{Amount, Diced, Displacement, FaceGrid, Function, Rates, Surface};

/// Corners of quads at a motion key: points and normals, unit ones unless they are a mean.
pub(in crate::accel) type Corners = Vec<[Vec3; 2]>;

/// A limit surface, and the same moved along its normals.
pub(in crate::accel) struct Lifted {
    pub(in crate::accel) plain: Surface,
    /// Moved by `far`.
    pub(in crate::accel) lifted: Surface,
    /// The object's size.
    pub(in crate::accel) far: f32,
}

impl Lifted {
    /// Of the limit surface of one that is displaced.
    pub(in crate::accel) fn new(displaced: &Surface) -> Self {
        let plain = displaced.with_displacement(Displacement::None);
        let diced = Diced::new(&plain, &Rates::uniform(&plain, 1));
        let bounds = Bounds3::of(diced.positions().iter().flatten().copied());
        let size = bounds.extent().length();
        let far = if size > 0.0 && size.is_finite() {
            size
        } else {
            1.0
        };
        let up = Function::scalar(|_| 1.0).bounded(|_| Bounds3::of([Vec3::X]));
        let lifted = displaced.with_displacement(Displacement::Scalar(Amount {
            map: Arc::new(up),
            scale: far,
            bias: 0.0,
        }));
        Self { plain, lifted, far }
    }

    /// The micro-vertices at these rates with their normals, at each motion key.
    pub(in crate::accel) fn corners(&self, rates: &Rates) -> (Vec<FaceGrid>, Vec<Corners>) {
        let [plain, lifted] = [&self.plain, &self.lifted].map(|s| Diced::new(s, rates));
        let keys = plain.positions().iter().zip(lifted.positions().iter());
        let corners = keys
            .map(|(low, high)| {
                let pairs = low.iter().zip(high);
                pairs.map(|(&p, &q)| [p, (q - p) / self.far]).collect()
            })
            .collect();
        (plain.grids().to_vec(), corners)
    }
}
