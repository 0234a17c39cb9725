//! Transforms over the shutter: keys, how many of them, and products of moving ones.

use crate::math::DAffine3;

/// More keys than this are never made.
pub(super) const MAX_KEYS: usize = 17;

/// A transform at evenly spaced moments from shutter open to shutter close; one key stands still.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Motion(Vec<DAffine3>);

impl Motion {
    /// Evaluates `at` (0 shutter open, 1 shutter close) with as few keys as show the motion: more while the
    /// middle between two keys is not what lies between them.
    pub(super) fn sample(at: impl Fn(f64) -> DAffine3) -> Self {
        let mut keys = vec![at(0.0), at(1.0)];
        loop {
            let spans = keys.len() - 1;
            let middles: Vec<_> = (0..spans)
                .map(|i| at((i as f64 + 0.5) / spans as f64))
                .collect();
            let enough = keys.len() >= MAX_KEYS
                || middles
                    .iter()
                    .enumerate()
                    .all(|(i, m)| close(*m, lerp(keys[i], keys[i + 1], 0.5)));
            if enough && (spans > 1 || keys.len() >= MAX_KEYS || quarters(&at, &keys)) {
                break;
            }
            let mut finer = Vec::with_capacity(2 * spans + 1);
            for (key, middle) in keys.iter().zip(&middles) {
                finer.extend([*key, *middle]);
            }
            finer.push(keys[spans]);
            keys = finer;
        }
        let first = keys[0];
        if keys.iter().all(|k| *k == first) {
            keys.truncate(1);
        }
        Self(keys)
    }

    /// Of keys that are known already: as few of them as show the motion.
    pub(super) fn from_keys(keys: Vec<DAffine3>) -> Self {
        let all = Self(keys);
        let first = all.0[0];
        if all.0.iter().all(|k| *k == first) {
            return first.into();
        }
        let ends = Self(vec![first, all.0[all.0.len() - 1]]);
        let spans = (all.0.len() - 1) as f64;
        let straight = all
            .0
            .iter()
            .enumerate()
            .all(|(i, k)| close(*k, ends.at(i as f64 / spans)));
        if straight { ends } else { all }
    }

    /// `self` after `local`.
    pub(super) fn then(&self, local: &Self) -> Self {
        match (self.0.as_slice(), local.0.as_slice()) {
            ([a], _) => Self(local.0.iter().map(|b| *a * *b).collect()),
            (_, [b]) => Self(self.0.iter().map(|a| *a * *b).collect()),
            _ => Self::sample(|t| self.at(t) * local.at(t)),
        }
    }

    /// Between the keys.
    pub(super) fn at(&self, t: f64) -> DAffine3 {
        let spans = self.0.len() - 1;
        let x = t.clamp(0.0, 1.0) * spans as f64;
        let i = (x as usize).min(spans.saturating_sub(1));
        match self.0.get(i + 1) {
            Some(next) => lerp(self.0[i], *next, x - i as f64),
            None => self.0[i],
        }
    }

    /// The keys.
    pub(super) fn keys(&self) -> &[DAffine3] {
        &self.0
    }

    /// Whether every key is finite and can be inverted.
    pub(super) fn is_usable(&self) -> bool {
        self.0.iter().all(|k| {
            let scale =
                k.matrix3.x_axis.length() * k.matrix3.y_axis.length() * k.matrix3.z_axis.length();
            k.is_finite()
                && scale > 0.0
                && k.matrix3.determinant().abs() > 1e-14 * scale
                && k.inverse().is_finite()
        })
    }
}

impl From<DAffine3> for Motion {
    fn from(transform: DAffine3) -> Self {
        Self(vec![transform])
    }
}

/// A motion of two keys may agree in the middle by symmetry: looks at the quarters too.
fn quarters(at: &impl Fn(f64) -> DAffine3, keys: &[DAffine3]) -> bool {
    [0.25, 0.75]
        .into_iter()
        .all(|t| close(at(t), lerp(keys[0], keys[1], t)))
}

fn lerp(a: DAffine3, b: DAffine3, t: f64) -> DAffine3 {
    DAffine3 {
        matrix3: a.matrix3 * (1.0 - t) + b.matrix3 * t,
        translation: a.translation * (1.0 - t) + b.translation * t,
    }
}

/// Equal to about a thousandth of a degree, and to a hundred-thousandth of what it moves by.
fn close(a: DAffine3, b: DAffine3) -> bool {
    let size = |m: DAffine3| {
        [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis]
            .into_iter()
            .map(|c| c.abs().max_element())
            .fold(0.0, f64::max)
    };
    let turned = DAffine3 {
        matrix3: a.matrix3 - b.matrix3,
        translation: glam::DVec3::ZERO,
    };
    let moved = (a.translation - b.translation).abs().max_element();
    size(turned) <= 2e-5 * size(a).max(size(b))
        && moved <= 1e-5 * (size(a) + a.translation.abs().max_element().min(1e3 * size(a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn straight_motion_has_two_keys_and_rotation_more() {
        let straight = Motion::sample(|t| DAffine3::from_translation(DVec3::X * t));
        assert_eq!(straight.keys().len(), 2);
        let still = Motion::sample(|_| DAffine3::IDENTITY);
        assert_eq!(still.keys().len(), 1);
        let turn = |t: f64| DAffine3::from_quat(DQuat::from_rotation_z(t));
        let turning = Motion::sample(turn);
        assert!(turning.keys().len() > 2 && turning.keys().len() <= MAX_KEYS);
        assert!((turning.at(0.3).matrix3.x_axis - turn(0.3).matrix3.x_axis).length() < 1e-3);
        let both = straight.then(&turning);
        assert!((both.at(1.0).translation - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn flat_and_infinite_transforms_are_not_usable() {
        assert!(Motion::from(DAffine3::from_scale(DVec3::splat(1e-6))).is_usable());
        assert!(!Motion::from(DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))).is_usable());
        assert!(!Motion::from(DAffine3::from_translation(DVec3::X * f64::NAN)).is_usable());
    }
}
