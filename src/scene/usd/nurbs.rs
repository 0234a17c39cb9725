//! UsdGeomNurbsPatch.

use openusd::tf::Token;
use openusd::usd::Prim;

use super::value;
use super::walk::{Reader, State};
use crate::error::Fault;
use crate::mesh::{NurbsDirection, NurbsForm, NurbsPatch, TrimCurve, TrimLoop};
use crate::scene::UnusablePrimvar;

impl Reader {
    /// The patch itself; `None`, with a warning, if it has no points.
    pub(super) fn nurbs_patch(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
    ) -> Result<Option<(NurbsPatch, Vec<UnusablePrimvar>)>, Fault> {
        let path = prim.path().as_str().to_owned();
        let points = self.points(prim);
        let [u, v] = [self.direction(prim, 'u')?, self.direction(prim, 'v')?];
        if points.iter().all(Vec::is_empty) && u.count * v.count == 0 {
            self.warn("empty patch", || {
                format!("{path}: the patch has no points; it is left out")
            });
            return Ok(None);
        }
        let mut patch = NurbsPatch {
            u,
            v,
            points,
            weights: self
                .doubles(prim, "pointWeights")
                .filter(|weights| !weights.is_empty()),
            trims: self.trims(prim)?,
            left_handed: self.word(prim, "orientation").as_deref() == Some("leftHanded"),
            primvars: Vec::new(),
        };
        patch.validate()?;
        let (primvars, unusable) =
            self.usable_primvars(prim, names, state, |p| patch.validate_primvar(p));
        patch.primvars = primvars;
        Ok(Some((patch, unusable)))
    }

    fn direction(&self, prim: &Prim, name: char) -> Result<NurbsDirection, Fault> {
        let form = self.word(prim, &format!("{name}Form")).unwrap_or_default();
        Ok(NurbsDirection {
            order: self.count(prim, &format!("{name}Order"))?,
            count: self.count(prim, &format!("{name}VertexCount"))?,
            knots: self
                .doubles(prim, &format!("{name}Knots"))
                .unwrap_or_default(),
            range: self
                .doubles(prim, &format!("{name}Range"))
                .and_then(|range| range.first_chunk::<2>().copied()),
            form: match form.as_str() {
                "closed" => NurbsForm::Closed,
                "periodic" => NurbsForm::Periodic,
                _ => NurbsForm::Open,
            },
        })
    }

    /// A whole number from 0; 0 if there is none.
    fn count(&self, prim: &Prim, name: &str) -> Result<usize, Fault> {
        let number = self.number(prim, name).unwrap_or(0.0);
        if (0.0..=f64::from(u32::MAX)).contains(&number) {
            Ok(number as usize)
        } else {
            Err(Fault::new(format!("{name} is {number}"))
                .advise("orders and counts are whole numbers above 0"))
        }
    }

    fn doubles(&self, prim: &Prim, name: &str) -> Option<Vec<f64>> {
        self.value(prim, name).and_then(value::doubles)
    }

    /// The loops of trim curves, taken out of the flat arrays that hold one entry a curve.
    fn trims(&self, prim: &Prim) -> Result<Vec<TrimLoop>, Fault> {
        let whole = |name: &str| -> Result<Vec<usize>, Fault> {
            let name = format!("trimCurve:{name}");
            let values =
                super::primvar::to_u32(self.integers(prim, &name), || format!("{name} hold"))?;
            Ok(values.into_iter().map(|v| v as usize).collect())
        };
        let numbers = |name: &str| {
            self.doubles(prim, &format!("trimCurve:{name}"))
                .unwrap_or_default()
        };
        let (loops, orders, counts) = (whole("counts")?, whole("orders")?, whole("vertexCounts")?);
        let (knots, ranges, points) = (numbers("knots"), numbers("ranges"), numbers("points"));
        let curves = sum(&loops);
        for (name, found, needed) in [
            ("orders", orders.len(), curves),
            ("vertexCounts", counts.len(), curves),
            ("ranges", ranges.len() / 2, curves),
            (
                "knots",
                knots.len(),
                sum(&counts).saturating_add(sum(&orders)),
            ),
            ("points", points.len() / 3, sum(&counts)),
        ] {
            if found != needed {
                return Err(Fault::new(format!(
                    "trimCurve:{name} hold {found} elements where trimCurve:counts, vertexCounts and orders need {needed}"
                ))
                .advise("all of trimCurve: must come from the same version of the patch"));
            }
        }
        let (mut knots, mut points) = (knots.as_slice(), points.as_slice());
        let mut all = orders
            .iter()
            .zip(&counts)
            .zip(ranges.as_chunks::<2>().0)
            .map(|((&order, &count), &range)| TrimCurve {
                order,
                knots: taken(&mut knots, order + count).to_vec(),
                range,
                points: taken(&mut points, 3 * count).as_chunks::<3>().0.to_vec(),
            });
        Ok(loops
            .into_iter()
            .map(|count| all.by_ref().take(count).collect())
            .collect())
    }
}

fn sum(numbers: &[usize]) -> usize {
    numbers.iter().fold(0, |sum, &n| sum.saturating_add(n))
}

/// The first `count` of `all`, which then begins behind them.
fn taken<'a>(all: &mut &'a [f64], count: usize) -> &'a [f64] {
    let (first, rest) = all.split_at(count);
    *all = rest;
    first
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::scene::Geometry;
    use crate::scene::usd::tests::{kinds, read, refused};

    /// A patch with every attribute; `more` replaces or adds some.
    fn patch(more: &[(&str, &str)]) -> String {
        let mut attributes = vec![
            ("int uOrder", "3"),
            ("int vOrder", "2"),
            ("int uVertexCount", "3"),
            ("int vVertexCount", "2"),
            ("double[] uKnots", "[0, 0, 0, 2, 2, 2]"),
            ("double[] vKnots", "[-1, -1, 1, 1]"),
            ("double2 uRange", "(0.5, 1.5)"),
            ("uniform token uForm", "\"closed\""),
            ("uniform token vForm", "\"periodic\""),
            (
                "point3f[] points",
                "[(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]",
            ),
            ("double[] pointWeights", "[1, 0.1, 1, 1, 2, 1]"),
            ("uniform token orientation", "\"leftHanded\""),
            ("int[] trimCurve:counts", "[2, 1]"),
            ("int[] trimCurve:orders", "[2, 2, 2]"),
            ("int[] trimCurve:vertexCounts", "[3, 2, 4]"),
            (
                "double[] trimCurve:knots",
                "[0, 0, 1, 2, 2, 0, 0, 1, 1, 0, 0, 1, 2, 3, 3]",
            ),
            ("double2[] trimCurve:ranges", "[(0, 2), (0, 1), (0, 3)]"),
            (
                "double3[] trimCurve:points",
                "[(0, 0, 1), (1, 0, 1), (1, 1, 1), (1, 1, 1), (0, 0, 1), (0, 0, 1), (4, 0, 2), (0, 1, 1), (0, 0, 1)]",
            ),
        ];
        for &(name, value) in more {
            attributes.retain(|(n, _)| n.rsplit(' ').next() != name.rsplit(' ').next());
            attributes.push((name, value));
        }
        let lines: Vec<_> = attributes
            .iter()
            .map(|(name, value)| format!("    {name} = {value}"))
            .collect();
        format!("def NurbsPatch \"P\" {{\n{}\n}}", lines.join("\n"))
    }

    #[test]
    fn every_attribute_of_a_patch() {
        let scene = read(&patch(&[
            (
                "float[] primvars:w",
                "[1, 2, 3, 4, 5, 6] (interpolation = \"vertex\")",
            ),
            (
                "float[] primvars:k",
                "[1, 2, 3, 4] (interpolation = \"faceVarying\")",
            ),
        ]));
        assert_eq!(kinds(&scene), ["unusable primvar"]);
        let Geometry::Nurbs(patch) = &scene.shapes[0].geometry else {
            panic!("not a patch");
        };
        assert_eq!([patch.u.order, patch.v.order], [3, 2]);
        assert_eq!([patch.u.count, patch.v.count], [3, 2]);
        assert_eq!(patch.u.knots, [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]);
        assert_eq!([patch.u.range, patch.v.range], [Some([0.5, 1.5]), None]);
        assert_eq!(patch.v.domain(), [-1.0, 1.0]);
        assert_eq!(
            [patch.u.form, patch.v.form],
            [NurbsForm::Closed, NurbsForm::Periodic]
        );
        assert_eq!(patch.points[0][4], Vec3::new(1.0, 1.0, 0.0));
        // Full precision: 0.1 is a double.
        assert_eq!(patch.weights.as_deref().map(|w| w[1]), Some(0.1));
        assert!(patch.left_handed);
        let sizes: Vec<_> = patch
            .trims
            .iter()
            .map(|curves| curves.iter().map(|c| c.points.len()).collect::<Vec<_>>())
            .collect();
        assert_eq!(sizes, [vec![3, 2], vec![4]]);
        assert_eq!(patch.trims[1][0].points[1], [4.0, 0.0, 2.0]);
        assert_eq!(patch.trims[1][0].range, [0.0, 3.0]);
        assert!(patch.primvar("w").is_some() && patch.primvar("k").is_none());
    }

    #[test]
    fn points_move() {
        let scene = read(&format!(
            "(\n    startTimeCode = 1\n)\ndef Camera \"C\" {{ double shutter:close = 1 }}\n{}",
            patch(&[(
                "point3f[] points.timeSamples",
                "{ 1: [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)],
                   2: [(0, 0, 1), (1, 0, 1), (2, 0, 1), (0, 1, 1), (1, 1, 1), (2, 1, 1)] }"
            )])
        ));
        let Geometry::Nurbs(patch) = &scene.shapes[0].geometry else {
            panic!("not a patch");
        };
        assert_eq!(patch.points.len(), 2);
        assert_eq!(patch.points[1][0], Vec3::Z);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (attribute, message) in [
            (("int uOrder", "-3"), "uOrder is -3"),
            (("int vOrder", "1"), "vOrder is 1"),
            (
                ("double[] uKnots", "[0, 0, 0, 1]"),
                "uKnots: 4 knots for 3 points of order 3",
            ),
            (
                ("double[] pointWeights", "[1, 0, 1, 1, 1, 1]"),
                "pointWeight 1 is 0",
            ),
            (
                ("int[] trimCurve:counts", "[2, 7]"),
                "trimCurve:orders hold 3",
            ),
            (
                ("int[] trimCurve:counts", "[-1]"),
                "trimCurve:counts hold -1",
            ),
            (
                ("double3[] trimCurve:points", "[(0, 0, 1)]"),
                "trimCurve:points hold 1 elements",
            ),
            (
                ("double2[] trimCurve:ranges", "[(0, 2), (0, 1), (1, 9)]"),
                "trim curve 2: range (1, 9) leaves",
            ),
            (("point3f[] points", "[(0, 0, 0)]"), "has 1 points"),
        ] {
            let fault = refused(&patch(&[attribute]));
            assert!(fault.message.contains(message), "{fault}");
            assert_eq!(fault.prim.as_deref(), Some("/P"));
        }
    }
}
