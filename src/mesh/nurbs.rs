//! A NURBS patch as a file states it, as plain arrays, and whether it is one.
//!
//! Words and layout are those of UsdGeomNurbsPatch. A row of points runs along u, and one row follows another along
//! v: point `(i, j)` is number `i + j * u.count`.

use super::Primvar;
use crate::error::Fault;
use crate::math::{Bounds3, Vec3};

/// A rational B-spline surface, perhaps trimmed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NurbsPatch {
    /// Along a row of points.
    pub u: NurbsDirection,
    /// From row to row.
    pub v: NurbsDirection,
    /// The points at each motion key, evenly over the shutter: at least one key, `u.count * v.count` points each.
    /// They are places in space: weights are not multiplied into them.
    pub points: Vec<Vec<Vec3>>,
    /// A weight above 0 for each point; without it all are 1.
    pub weights: Option<Vec<f64>>,
    /// Loops of curves in the plane of the parameters. What they wind around an odd number of times is kept;
    /// without loops the whole patch is.
    pub trims: Vec<TrimLoop>,
    /// Whether the front is where dP/du x dP/dv points away from.
    pub left_handed: bool,
    /// Values that the surface carries.
    pub primvars: Vec<Primvar>,
}

/// One of the two parameters of a patch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NurbsDirection {
    /// Degree + 1, from 2 to [`MAX_ORDER`].
    pub order: usize,
    /// Points along it, at least `order`.
    pub count: usize,
    /// `count + order` numbers that never fall.
    pub knots: Vec<f64>,
    /// The part of the parameter that is surface, within the knots' domain; without it the whole domain is.
    pub range: Option<[f64; 2]>,
    /// What the author meant the ends to do.
    pub form: NurbsForm,
}

/// What the author of a patch meant its two ends to do. The points say what they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NurbsForm {
    /// Nothing in particular.
    #[default]
    Open,
    /// To meet.
    Closed,
    /// To meet smoothly: the last `order - 1` points repeat the first ones.
    Periodic,
}

/// Curves, each beginning where the one before ends; the last leads back to the first.
pub type TrimLoop = Vec<TrimCurve>;

/// A rational B-spline curve in the plane of the parameters.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrimCurve {
    /// Degree + 1, from 2 to [`MAX_ORDER`].
    pub order: usize,
    /// One for each point and `order` more; they never fall.
    pub knots: Vec<f64>,
    /// The part of the curve that counts.
    pub range: [f64; 2],
    /// Homogeneous (u, v, w): the curve runs by (u / w, v / w). w is above 0.
    pub points: Vec<[f64; 3]>,
}

/// Orders above this are refused: the scratch space of an evaluation is fixed, and degrees that occur are far below.
pub const MAX_ORDER: usize = 64;

/// Weights must lie within this factor of 1, so that squares of them and their quotients stay finite.
const WEIGHT_LIMIT: f64 = 1e30;

impl NurbsPatch {
    /// How many points each motion key has.
    pub fn point_count(&self) -> usize {
        self.points.first().map_or(0, Vec::len)
    }

    /// How many polynomial pieces the patch has: spans between different knots, within the ranges.
    pub fn face_count(&self) -> usize {
        self.u.spans().count() * self.v.spans().count()
    }

    /// The primvar of this name.
    pub fn primvar(&self, name: &str) -> Option<&Primvar> {
        self.primvars.iter().find(|p| p.name == name)
    }

    /// The box around the points at all motion keys: the surface lies within it.
    pub fn bounds(&self) -> Bounds3 {
        Bounds3::of(self.points.iter().flatten().copied())
    }

    /// Bytes that its arrays hold.
    pub fn memory(&self) -> usize {
        let curve = |c: &TrimCurve| {
            size_of_val(c.knots.as_slice()) + size_of_val(c.points.as_slice()) + size_of_val(c)
        };
        8 * (self.u.knots.len() + self.v.knots.len() + self.weights.as_ref().map_or(0, Vec::len))
            + self
                .points
                .iter()
                .map(|p| size_of_val(p.as_slice()))
                .sum::<usize>()
            + self.trims.iter().flatten().map(curve).sum::<usize>()
            + self.primvars.iter().map(Primvar::memory).sum::<usize>()
    }

    /// Checks everything that later stages rely on.
    ///
    /// # Errors
    /// The first fault found: orders below 2 or above [`MAX_ORDER`], too few points, a wrong number of knots,
    /// knots that fall or span nothing, ranges outside the knots' domain, weights that are not above 0, numbers
    /// that are not finite, primvars of the wrong length, motion keys of different lengths.
    pub fn validate(&self) -> Result<(), Fault> {
        self.u.validate("u")?;
        self.v.validate("v")?;
        self.validate_points()?;
        let mut number = 0;
        for (index, curves) in self.trims.iter().enumerate() {
            if curves.is_empty() {
                return Err(Fault::new(format!("trim loop {index} has no curves"))
                    .advise("trimCurve:counts are 1 or more; remove the loop"));
            }
            for curve in curves {
                curve.validate(number)?;
                number += 1;
            }
        }
        self.primvars
            .iter()
            .try_for_each(|p| self.validate_primvar(p))
    }

    /// Checks a primvar that this patch is to carry.
    ///
    /// # Errors
    /// The first fault found: a wrong count, an interpolation that patches do not have, a number that is not finite.
    pub fn validate_primvar(&self, primvar: &Primvar) -> Result<(), Fault> {
        primvar.validate_count(self.elements(primvar))
    }

    /// How many elements a primvar must have and what for; `None` for interpolations that patches do not have.
    fn elements(&self, primvar: &Primvar) -> Option<(usize, &'static str)> {
        use super::Interpolation as I;
        let segments = self.segments();
        Some(match primvar.interpolation {
            I::Constant => (1, "a constant"),
            I::Uniform => (segments[0] * segments[1], "segments"),
            I::Varying => ((segments[0] + 1) * (segments[1] + 1), "segment corners"),
            I::Vertex => (self.point_count(), "points"),
            I::FaceVarying => return None,
        })
    }

    /// Segments between successive knots in u and v, those without extent included: what uniform and varying
    /// primvars count by, as in RenderMan's NuPatch.
    pub fn segments(&self) -> [usize; 2] {
        [&self.u, &self.v].map(|d| d.count + 1 - d.order)
    }

    fn validate_points(&self) -> Result<(), Fault> {
        let needed = self.u.count.saturating_mul(self.v.count);
        if self.points.is_empty() {
            return Err(Fault::new("the patch has no points"));
        }
        if u32::try_from(needed).is_err() {
            return Err(Fault::new(format!(
                "{needed} points are more than 32 bits can number"
            )));
        }
        for (key, points) in self.points.iter().enumerate() {
            if points.len() != needed {
                return Err(Fault::new(format!(
                    "motion key {key} has {} points; uVertexCount {} x vVertexCount {} need {needed}",
                    points.len(),
                    self.u.count,
                    self.v.count
                ))
                .advise("points and counts must come from the same version of the patch"));
            }
            if let Some(i) = points.iter().position(|p| !super::validate::usable(*p)) {
                return Err(
                    Fault::new(format!("point {i} is {}, not a usable number", points[i])).advise(
                        "repair the points where they are exported; coordinates up to 1e18 are accepted",
                    ),
                );
            }
        }
        let Some(weights) = &self.weights else {
            return Ok(());
        };
        if weights.len() != needed {
            return Err(Fault::new(format!(
                "{} pointWeights for {needed} points",
                weights.len()
            ))
            .advise("give one weight for each point, or none at all"));
        }
        match weights.iter().position(|&w| !usable_weight(w)) {
            Some(i) => Err(Fault::new(format!("pointWeight {i} is {}", weights[i]))
                .advise("weights are finite and above 0, between 1e-30 and 1e30")),
            None => Ok(()),
        }
    }
}

impl NurbsDirection {
    /// Degree of the polynomials.
    pub fn degree(&self) -> usize {
        self.order - 1
    }

    /// The part of the parameter that is surface: the range if there is one, else all where the basis is complete.
    pub fn domain(&self) -> [f64; 2] {
        self.range
            .unwrap_or([self.knots[self.order - 1], self.knots[self.count]])
    }

    /// The spans between different knots as far as they lie in the domain: number of the knot below, and the part.
    pub fn spans(&self) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
        spans(&self.knots, self.order, self.count, self.domain())
    }

    fn validate(&self, name: &str) -> Result<(), Fault> {
        let words = Words {
            order: format!("{name}Order"),
            count: format!("{name}VertexCount"),
            knots: format!("{name}Knots"),
            range: format!("{name}Range"),
        };
        validate_knots(&words, self.order, self.count, &self.knots, self.range)
    }
}

impl TrimCurve {
    /// The spans between different knots as far as they lie in the range: number of the knot below, and the part.
    pub fn spans(&self) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
        spans(&self.knots, self.order, self.points.len(), self.range)
    }

    fn validate(&self, number: usize) -> Result<(), Fault> {
        let words = Words {
            order: format!("trim curve {number}: order"),
            count: format!("trim curve {number}: vertexCount"),
            knots: format!("trim curve {number}: knots"),
            range: format!("trim curve {number}: range"),
        };
        let (count, range) = (self.points.len(), Some(self.range));
        validate_knots(&words, self.order, count, &self.knots, range)?;
        let bad = |p: &[f64; 3]| {
            !usable_weight(p[2]) || !p[0].is_finite() || !p[1].is_finite() || {
                let [u, v] = [p[0] / p[2], p[1] / p[2]];
                u.abs().max(v.abs()) > 1e100
            }
        };
        match self.points.iter().position(bad) {
            Some(i) => Err(Fault::new(format!(
                "trim curve {number}: point {i} is {:?}",
                self.points[i]
            ))
            .advise("trim points are finite (u, v, w) with w above 0")),
            None => Ok(()),
        }
    }
}

fn usable_weight(w: f64) -> bool {
    (1.0 / WEIGHT_LIMIT..=WEIGHT_LIMIT).contains(&w)
}

fn spans(
    knots: &[f64],
    order: usize,
    count: usize,
    [low, high]: [f64; 2],
) -> impl Iterator<Item = (usize, [f64; 2])> + '_ {
    (order - 1..count).filter_map(move |i| {
        let part = [knots[i].max(low), knots[i + 1].min(high)];
        (part[0] < part[1]).then_some((i, part))
    })
}

/// What a file calls the numbers of a direction or curve.
struct Words {
    order: String,
    count: String,
    knots: String,
    range: String,
}

fn validate_knots(
    words: &Words,
    order: usize,
    count: usize,
    knots: &[f64],
    range: Option<[f64; 2]>,
) -> Result<(), Fault> {
    if !(2..=MAX_ORDER).contains(&order) {
        return Err(
            Fault::new(format!("{} is {order}", words.order)).advise(format!(
                "an order is the degree + 1: from 2 (straight) to {MAX_ORDER}"
            )),
        );
    }
    if count < order {
        return Err(Fault::new(format!(
            "{} is {count}, too few points for order {order}",
            words.count
        ))
        .advise("there must be at least as many points as the order"));
    }
    let needed = count.saturating_add(order);
    if knots.len() != needed {
        return Err(Fault::new(format!(
            "{}: {} knots for {count} points of order {order}",
            words.knots,
            knots.len()
        ))
        .advise(format!("points + order = {needed} knots are needed")));
    }
    if let Some(i) = knots
        .iter()
        .position(|k| k.is_nan() || k.abs() > KNOT_LIMIT)
    {
        return Err(
            Fault::new(format!("{}: knot {i} is {}", words.knots, knots[i]))
                .advise("knots are finite numbers, not beyond 1e100"),
        );
    }
    if let Some(i) = knots.windows(2).position(|k| k[0] > k[1]) {
        return Err(Fault::new(format!(
            "{}: knots fall from {} (knot {i}) to {}",
            words.knots,
            knots[i],
            knots[i + 1]
        ))
        .advise("knots never fall from one to the next"));
    }
    let [low, high] = [knots[order - 1], knots[count]];
    if low >= high {
        return Err(Fault::new(format!(
            "{}: the domain, knot {} to knot {count}, is the single value {low}",
            words.knots,
            order - 1
        ))
        .advise("some knots in the middle must differ"));
    }
    if let Some([start, end]) = range {
        if start.is_nan() || end.is_nan() || start >= end {
            return Err(
                Fault::new(format!("{} ({start}, {end}) is empty", words.range))
                    .advise("a range runs from a smaller to a larger number"),
            );
        }
        if start < low || end > high {
            return Err(Fault::new(format!(
                "{} ({start}, {end}) leaves the knots' domain, {low} to {high}",
                words.range
            ))
            .advise(format!(
                "the domain runs from knot {} to knot {count}",
                order - 1
            )));
        }
    }
    Ok(())
}

/// Differences of knots within this, and quotients of such differences, are finite.
const KNOT_LIMIT: f64 = 1e100;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Interpolation;

    fn patch() -> NurbsPatch {
        let direction = NurbsDirection {
            order: 3,
            count: 3,
            knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            ..NurbsDirection::default()
        };
        let curve = TrimCurve {
            order: 2,
            knots: vec![0.0, 0.0, 1.0, 2.0, 3.0, 3.0],
            range: [0.0, 3.0],
            points: vec![
                [0.1, 0.1, 1.0],
                [0.9, 0.1, 1.0],
                [0.5, 0.9, 1.0],
                [0.1, 0.1, 1.0],
            ],
        };
        NurbsPatch {
            u: direction.clone(),
            v: direction,
            points: vec![(0..9).map(|i| Vec3::splat(i as f32)).collect()],
            weights: Some(vec![1.0; 9]),
            trims: vec![vec![curve]],
            primvars: vec![Primvar {
                name: "st".into(),
                interpolation: Interpolation::Varying,
                width: 2,
                values: vec![0.0; 8],
                indices: None,
            }],
            ..NurbsPatch::default()
        }
    }

    #[test]
    fn spans_skip_repeated_knots_and_keep_to_the_range() {
        assert_eq!(patch().validate(), Ok(()));
        let direction = NurbsDirection {
            order: 3,
            count: 6,
            knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 3.0, 4.0, 4.0, 4.0],
            range: Some([0.5, 3.5]),
            ..NurbsDirection::default()
        };
        assert_eq!(direction.validate("u"), Ok(()));
        let spans: Vec<_> = direction.spans().collect();
        assert_eq!(spans, [(2, [0.5, 1.0]), (4, [1.0, 3.0]), (5, [3.0, 3.5])]);
    }

    type Spoil = fn(&mut NurbsPatch);

    #[test]
    fn each_fault_says_what_it_found() {
        let faults: &[(&str, Spoil)] = &[
            ("uOrder is 1", |p| p.u.order = 1),
            ("vOrder is 65", |p| p.v.order = 65),
            ("uVertexCount is 2, too few points", |p| p.u.count = 2),
            ("vKnots: 5 knots for 3 points of order 3", |p| {
                p.v.knots.truncate(5);
            }),
            ("uKnots: knots fall from 2 (knot 1) to 0", |p| {
                p.u.knots[1] = 2.0;
            }),
            ("uKnots: knot 4 is NaN", |p| p.u.knots[4] = f64::NAN),
            ("vKnots: knot 5 is inf", |p| p.v.knots[5] = f64::INFINITY),
            ("is the single value 0", |p| p.u.knots = vec![0.0; 6]),
            ("uRange (0, 2) leaves the knots' domain, 0 to 1", |p| {
                p.u.range = Some([0.0, 2.0]);
            }),
            ("vRange (1, 0) is empty", |p| p.v.range = Some([1.0, 0.0])),
            ("vRange (NaN, 1) is empty", |p| {
                p.v.range = Some([f64::NAN, 1.0]);
            }),
            ("has no points", |p| p.points.clear()),
            ("has 8 points", |p| p.points[0].truncate(8)),
            ("motion key 1 has 0 points", |p| p.points.push(Vec::new())),
            ("point 3 is", |p| p.points[0][3].z = f32::NAN),
            ("pointWeight 2 is 0", |p| {
                p.weights.as_mut().expect("weights")[2] = 0.0;
            }),
            ("pointWeight 8 is -1", |p| {
                p.weights.as_mut().expect("weights")[8] = -1.0;
            }),
            ("pointWeight 0 is NaN", |p| {
                p.weights.as_mut().expect("weights")[0] = f64::NAN;
            }),
            ("4 pointWeights for 9 points", |p| {
                p.weights.as_mut().expect("weights").truncate(4);
            }),
            ("trim loop 1 has no curves", |p| p.trims.push(Vec::new())),
            ("trim curve 0: knots: 5 knots", |p| {
                p.trims[0][0].knots.truncate(5);
            }),
            ("trim curve 0: range (0, 4) leaves", |p| {
                p.trims[0][0].range[1] = 4.0;
            }),
            ("trim curve 0: point 2 is [0.5, 0.9, 0.0]", |p| {
                p.trims[0][0].points[2][2] = 0.0;
            }),
            ("primvar st has 3 elements for 4 segment corners", |p| {
                p.primvars[0].values.truncate(6);
            }),
            ("primvar st is faceVarying", |p| {
                p.primvars[0].interpolation = Interpolation::FaceVarying;
            }),
        ];
        for (message, spoil) in faults {
            let mut patch = patch();
            spoil(&mut patch);
            let fault = patch.validate().expect_err(message);
            assert!(fault.to_string().contains(message), "{fault}");
        }
    }
}
