//! UsdGeomMesh and UsdGeomSubset, and the placing of shapes.

use std::rc::Rc;
use std::sync::Arc;

use openusd::tf::Token;
use openusd::usd::Prim;

use super::primvar::to_u32;
use super::value;
use super::walk::{Reader, State, has};
use crate::error::{Fault, Result};
use crate::math::Vec3;
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, FaceVaryingInterpolation, Interpolation,
    Primvar, Scheme, TriangleRule,
};
use crate::scene::{Binding, Geometry, Shape, Subset, UnusablePrimvar};

/// A shape that was read, and under which inherited state.
pub(super) struct Known {
    primvars: Rc<Vec<Primvar>>,
    has_material: bool,
    /// The material that overrides those of the subsets.
    over: Option<Option<usize>>,
    /// `None`: nothing to draw.
    shape: Option<usize>,
    /// Whether the mesh has a `displayColor` of its own.
    own_color: bool,
}

impl Reader {
    /// Reads a mesh or patch, or finds it among those that were read, and places it.
    pub(super) fn place_shape(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
    ) -> Result<()> {
        let key = if state.in_instance {
            prim.prim_in_prototype()
                .ok()
                .flatten()
                .map_or_else(|| prim.path().clone(), |p| p.path().clone())
        } else {
            prim.path().clone()
        };
        let bound = self.resolve_binding(prim, &state.inherited);
        let material = bound.as_ref().and_then(|b| self.material(prim, &b.target));
        let over = bound.filter(|b| b.strong).map(|_| material);
        let known = self.shape_of.get(key.as_str()).and_then(|all| {
            all.iter().position(|k| {
                k.has_material == material.is_some()
                    && k.over == over
                    && k.primvars == state.inherited.primvars
            })
        });
        let index = match known {
            Some(index) => index,
            None => {
                let geometry = self
                    .geometry(prim, names, state)
                    .map_err(|f| f.in_file(&self.file).at_prim(prim.path().as_str()))?;
                let own_color = has(names, "primvars:displayColor");
                let shape = match geometry {
                    Some((geometry, unusable_primvars)) => {
                        // The prim says which tiles: `key` tells them apart.
                        let tiles = self
                            .tiles(prim, names, &geometry, &unusable_primvars)
                            .map_err(|f| f.in_file(&self.file).at_prim(prim.path().as_str()))?;
                        let subsets = match geometry.mesh() {
                            Some(mesh) => self
                                .subsets(prim, state, mesh)
                                .map_err(|f| f.in_file(&self.file).at_prim(prim.path().as_str()))?,
                            None => Vec::new(),
                        };
                        self.shapes.push(Shape {
                            path: key.as_str().to_owned(),
                            geometry,
                            materials: Binding {
                                whole: material,
                                subsets,
                            },
                            double_sided: (self.truth(prim, "doubleSided"))
                                .unwrap_or_else(|| self.type_name(prim) == "Plane"),
                            unusable_primvars,
                            tiles,
                        });
                        Some(self.shapes.len() - 1)
                    }
                    None => None,
                };
                let all = self.shape_of.entry(key.as_str().to_owned()).or_default();
                all.push(Known {
                    primvars: state.inherited.primvars.clone(),
                    has_material: material.is_some(),
                    over,
                    shape,
                    own_color,
                });
                all.len() - 1
            }
        };
        let Some(known) = self
            .shape_of
            .get(key.as_str())
            .and_then(|all| all.get(index))
        else {
            return Ok(());
        };
        let Some(shape) = known.shape else {
            return Ok(());
        };
        let color = state.inherited.display_color.filter(|_| !known.own_color);
        let other = material.filter(|_| self.shapes[shape].materials.whole != material);
        self.place(prim, state, shape, color, other)
    }

    /// The surface itself; `None`, with a warning, if there is nothing to draw.
    fn geometry(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
    ) -> Result<Option<(Geometry, Vec<UnusablePrimvar>)>, Fault> {
        Ok(match self.type_name(prim).as_str() {
            "Mesh" => {
                let mesh = self.mesh(prim, names, state)?;
                mesh.map(|(mesh, unusable)| (Geometry::Mesh(Arc::new(mesh)), unusable))
            }
            "NurbsPatch" => {
                let patch = self.nurbs_patch(prim, names, state)?;
                patch.map(|(patch, unusable)| (Geometry::Nurbs(Arc::new(patch)), unusable))
            }
            gprim => self.gprim(prim, names, state, gprim)?,
        })
    }

    /// The mesh itself; `None`, with a warning, if it has no faces.
    fn mesh(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
    ) -> Result<Option<(ControlMesh, Vec<UnusablePrimvar>)>, Fault> {
        let path = prim.path().as_str().to_owned();
        let counts = self.integers(prim, "faceVertexCounts");
        if counts.is_empty() {
            self.warn("empty mesh", || {
                format!("{path}: the mesh has no faces; it is left out")
            });
            return Ok(None);
        }
        for api in ["SkelBindingAPI", "MeshLightAPI"] {
            if prim.has_api_schema(api).unwrap_or(false)
                && (api != "SkelBindingAPI" || has(names, "primvars:skel:jointIndices"))
            {
                self.warn(api, || match api {
                    "MeshLightAPI" => format!("{path}: a mesh as a light does not emit"),
                    _ => format!(
                        "{path}: skinning is not computed; the mesh is read as it is at rest"
                    ),
                });
            }
        }
        let word = |name: &str| self.word(prim, name).unwrap_or_default();
        let scheme = match word("subdivisionScheme").as_str() {
            "loop" => Scheme::Loop,
            "bilinear" => Scheme::Bilinear,
            "none" => Scheme::None,
            _ => Scheme::CatmullClark,
        };
        let boundary = match word("interpolateBoundary").as_str() {
            "none" => BoundaryInterpolation::None,
            "edgeOnly" => BoundaryInterpolation::EdgeOnly,
            _ => BoundaryInterpolation::EdgeAndCorner,
        };
        let face_varying = match word("faceVaryingLinearInterpolation").as_str() {
            "none" => FaceVaryingInterpolation::None,
            "cornersOnly" => FaceVaryingInterpolation::CornersOnly,
            "cornersPlus2" => FaceVaryingInterpolation::CornersPlus2,
            "boundaries" => FaceVaryingInterpolation::Boundaries,
            "all" => FaceVaryingInterpolation::All,
            _ => FaceVaryingInterpolation::CornersPlus1,
        };
        let triangle_rule = match word("triangleSubdivisionRule").as_str() {
            "smooth" => TriangleRule::Smooth,
            _ => TriangleRule::CatmullClark,
        };
        let left_handed = word("orientation") == "leftHanded";
        let corners = self.integers(prim, "faceVertexIndices");
        let mut mesh = ControlMesh {
            scheme,
            face_vertex_counts: to_u32(counts, || "faceVertexCounts hold".into())?,
            face_vertex_indices: to_u32(corners, || "faceVertexIndices hold".into())?,
            points: self.points(prim),
            creases: self.creases(prim)?,
            corners: self.corners(prim)?,
            holes: to_u32(self.integers(prim, "holeIndices"), || {
                "holeIndices hold".into()
            })?,
            boundary,
            face_varying,
            triangle_rule,
            left_handed,
            ..ControlMesh::default()
        };
        if mesh.points.iter().all(Vec::is_empty) {
            return Err(self.no_points(prim));
        }
        mesh.validate()?;
        if !mesh.has_area() {
            self.warn("mesh without area", || {
                format!("{path}: no face of the mesh has an area; it is left out")
            });
            return Ok(None);
        }
        if let Some((face, point)) = mesh.repeated_corner() {
            self.warn("repeated corner", || {
                format!("{path}: face {face}: point {point} is more than one of its corners; remove the repeated ones")
            });
        }
        if let Some((count, [a, b])) = mesh.creases_without_edge() {
            self.warn("crease without edge", || {
                format!("{path}: {count} creases have no effect: no edge joins their points, as {a} and {b}")
            });
        }
        let (primvars, unusable) =
            self.usable_primvars(prim, names, state, |p| mesh.validate_primvar(p));
        mesh.primvars = primvars;
        if scheme == Scheme::None {
            mesh.normals = self.normals(prim, names, &mesh);
        }
        Ok(Some((mesh, unusable)))
    }

    /// Shading normals, if there are any and they fit.
    fn normals(&mut self, prim: &Prim, names: &[Token], mesh: &ControlMesh) -> Option<Primvar> {
        let attribute = ["primvars:normals", "normals"]
            .into_iter()
            .find(|n| has(names, n))?;
        let normals = self.primvar(prim, attribute, "normals", Interpolation::Vertex);
        let checked = normals.and_then(|normals| {
            normals
                .filter(|n| n.width == 3)
                .map(|n| mesh.validate_primvar(&n).map(|()| n))
                .transpose()
        });
        match checked {
            Ok(normals) => normals,
            Err(fault) => {
                self.warn("unusable normals", || {
                    format!(
                        "{}: {fault}; the mesh shows its facets",
                        prim.path().as_str()
                    )
                });
                None
            }
        }
    }

    /// Why a mesh with faces has no points.
    pub(super) fn no_points(&self, prim: &Prim) -> Fault {
        let Some(value) = self.value(prim, "points") else {
            return Fault::new("the mesh has faces and no points")
                .advise("author point3f[] points");
        };
        let type_name = prim.attribute("points").type_name().ok().flatten();
        match (value::vectors(value), type_name) {
            (Some(_), _) => Fault::new("the mesh has faces, and its list of points is empty"),
            (None, Some(name)) if name.as_str() != "point3f[]" => {
                Fault::new(format!("the points are of type {}", name.as_str()))
            }
            (None, _) => Fault::new("the points are of another type than point3f[]"),
        }
        .advise("author point3f[] points")
    }

    /// An array of whole numbers, empty if there is none.
    pub(super) fn integers(&self, prim: &Prim, name: &str) -> Vec<i64> {
        self.value(prim, name)
            .and_then(value::integers)
            .unwrap_or_default()
    }

    /// An array of numbers, empty if there is none.
    fn numbers(&self, prim: &Prim, name: &str) -> Vec<f32> {
        self.value(prim, name)
            .and_then(value::floats)
            .map(|f| f.values)
            .unwrap_or_default()
    }

    /// One crease an edge, from chains with one sharpness each, or one an edge.
    fn creases(&self, prim: &Prim) -> Result<Vec<Crease>, Fault> {
        let indices = to_u32(self.integers(prim, "creaseIndices"), || {
            "creaseIndices hold".into()
        })?;
        let lengths = to_u32(self.integers(prim, "creaseLengths"), || {
            "creaseLengths hold".into()
        })?;
        let sharpnesses = self.numbers(prim, "creaseSharpnesses");
        let sum: u64 = lengths.iter().map(|&l| u64::from(l)).sum();
        if sum != indices.len() as u64 {
            return Err(Fault::new(format!(
                "creaseLengths add up to {sum}, but there are {} creaseIndices",
                indices.len()
            ))
            .advise("both must come from the same version of the mesh"));
        }
        if let Some(i) = lengths.iter().position(|&l| l < 2) {
            return Err(Fault::new(format!("crease {i} has {} points", lengths[i]))
                .advise("a crease has at least 2 points; remove it"));
        }
        let edges = indices.len() - lengths.len();
        let per_crease = sharpnesses.len() == lengths.len();
        if !per_crease && sharpnesses.len() != edges {
            return Err(Fault::new(format!(
                "{} creaseSharpnesses for {} creases of {edges} edges",
                sharpnesses.len(),
                lengths.len()
            ))
            .advise("give one sharpness for each crease, or one for each edge"));
        }
        let mut out = Vec::with_capacity(edges);
        let mut start = 0;
        for (i, &length) in lengths.iter().enumerate() {
            let end = start + length as usize;
            for pair in indices[start..end].windows(2) {
                let which = if per_crease { i } else { out.len() };
                out.push(Crease {
                    vertices: [pair[0], pair[1]],
                    sharpness: sharpnesses[which],
                });
            }
            start = end;
        }
        Ok(out)
    }

    fn corners(&self, prim: &Prim) -> Result<Vec<Corner>, Fault> {
        let indices = to_u32(self.integers(prim, "cornerIndices"), || {
            "cornerIndices hold".into()
        })?;
        let sharpnesses = self.numbers(prim, "cornerSharpnesses");
        if indices.len() != sharpnesses.len() {
            return Err(Fault::new(format!(
                "{} cornerSharpnesses for {} cornerIndices",
                sharpnesses.len(),
                indices.len()
            ))
            .advise("give one sharpness for each corner"));
        }
        Ok(indices
            .into_iter()
            .zip(sharpnesses)
            .map(|(vertex, sharpness)| Corner { vertex, sharpness })
            .collect())
    }

    /// The points at each motion key: moved by velocities if there are any for them, else as sampled.
    pub(super) fn points(&mut self, prim: &Prim) -> Vec<Vec<Vec3>> {
        let path = prim.path().as_str().to_owned();
        if self.is_spline(prim, "points") {
            self.warn("spline", || {
                format!("{path}.points: animation by splines is not read")
            });
        }
        let points_at = |reader: &Self, time: f64| {
            reader
                .value_at(prim, "points", time)
                .and_then(value::vectors)
                .unwrap_or_default()
        };
        let now = points_at(self, self.time);
        let Some([open, close]) = self.shutter else {
            return vec![now];
        };
        if let Some(velocities) = self.velocities(prim, "points", now.len()) {
            let seconds = |t: f64| ((t - self.time) / self.frames_per_second) as f32;
            let moved = |t: f64| -> Vec<Vec3> {
                let moving = now.iter().zip(&velocities);
                moving.map(|(p, v)| *p + *v * seconds(t)).collect()
            };
            return distinct(vec![moved(open), moved(close)]);
        }
        let attribute = prim.attribute("points");
        if !attribute.value_might_be_time_varying().unwrap_or(false) {
            return vec![now];
        }
        let between = attribute
            .time_sample_times()
            .unwrap_or_default()
            .into_iter()
            .filter(|t| *t > open && *t < close)
            .count();
        let spans = match between {
            0 => 1,
            1 => 2,
            _ => 4,
        };
        let keys: Vec<_> = (0..=spans)
            .map(|i| {
                points_at(
                    self,
                    open + (close - open) * f64::from(i) / f64::from(spans),
                )
            })
            .collect();
        if keys.iter().any(|k| k.len() != now.len()) {
            self.warn("points change in number", || {
                format!("{path}: the number of points changes within the shutter; the mesh is not blurred")
            });
            return vec![now];
        }
        distinct(keys)
    }

    /// The velocities, in units a second, that belong to the positions at the frame.
    pub(super) fn velocities(
        &self,
        prim: &Prim,
        positions: &str,
        count: usize,
    ) -> Option<Vec<Vec3>> {
        let velocities = prim.attribute("velocities");
        if count == 0 || !velocities.has_authored_value().unwrap_or(false) {
            return None;
        }
        let bracket = |name: &str| {
            prim.attribute(name)
                .bracketing_time_samples(self.time)
                .ok()
                .flatten()
                .map(|(lower, _)| lower)
        };
        let base = bracket(positions).unwrap_or(self.time);
        // Velocities count only with the positions of the same moment.
        if bracket("velocities").is_some_and(|own| (own - base).abs() > 1e-6) {
            return None;
        }
        self.value_at(prim, "velocities", base)
            .and_then(value::vectors)
            .filter(|v| v.len() == count)
    }

    /// Subsets of the family `materialBind`.
    fn subsets(
        &mut self,
        prim: &Prim,
        state: &State,
        mesh: &ControlMesh,
    ) -> Result<Vec<Subset>, Fault> {
        let mut out = Vec::new();
        let mut taken = vec![false; mesh.face_count()];
        for child in prim.children().unwrap_or_default() {
            if self.type_name(&child) != "GeomSubset" || !child.is_active().unwrap_or(false) {
                continue;
            }
            let family = self.word(&child, "familyName").unwrap_or_default();
            let element = self.word(&child, "elementType").unwrap_or_default();
            if family != "materialBind" || !matches!(element.as_str(), "" | "face") {
                continue;
            }
            let path = child.path().as_str().to_owned();
            let indices = to_u32(self.integers(&child, "indices"), || "indices hold".into())
                .map_err(|f| f.at_prim(&path))?;
            let mut faces = Vec::with_capacity(indices.len());
            let mut twice = 0;
            for face in indices {
                match taken.get_mut(face as usize) {
                    None => {
                        return Err(Fault::new(format!(
                            "indices name face {face}, but the mesh has {}",
                            mesh.face_count()
                        ))
                        .at_prim(path)
                        .advise("export the subset with the mesh that it belongs to"));
                    }
                    Some(true) => twice += 1,
                    Some(free) => {
                        *free = true;
                        faces.push(face);
                    }
                }
            }
            if twice > 0 {
                self.warn("overlapping subsets", || {
                    format!("{path}: {twice} faces are in an earlier subset and stay there")
                });
            }
            faces.sort_unstable();
            let names = self.authored(&child);
            let mut inherited = state.inherited.clone();
            self.inherit_bindings(&child, &names, &mut inherited);
            let bound = self.resolve_binding(&child, &inherited);
            let material = bound.and_then(|b| self.material(&child, &b.target));
            if !faces.is_empty() {
                out.push(Subset { faces, material });
            }
        }
        Ok(out)
    }
}

/// One key if all are the same.
fn distinct(mut keys: Vec<Vec<Vec3>>) -> Vec<Vec<Vec3>> {
    if keys.windows(2).all(|pair| pair[0] == pair[1]) {
        keys.truncate(1);
    }
    keys
}
