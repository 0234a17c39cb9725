//! RelievoShellAPI (`schema/schema.usda`): tiles of polygons that stand over a surface.
//!
//! The schema is honoured where its relationship has a target, whether it is applied or not. Of a tile, faces, points,
//! holes and orientation are read, at the frame: tiles do not move within the shutter.

use std::sync::Arc;

use openusd::sdf;
use openusd::tf::Token;
use openusd::usd::Prim;

use super::primvar::to_u32;
use super::value;
use super::walk::{Reader, has};
use crate::error::Fault;
use crate::math::Vec2;
use crate::mesh::{ControlMesh, Interpolation, Scheme};
use crate::scene::{Geometry, Tiles, UnusablePrimvar};

const API: &str = "RelievoShellAPI";
const TILE: &str = "relievo:shell:tile";
const REPEATS: &str = "relievo:shell:repeats";
const HEIGHT: &str = "relievo:shell:height";
const PRIMVAR: &str = "relievo:shell:primvar";

/// What the schema has where nothing is authored.
const DEFAULT_REPEATS: Vec2 = Vec2::ONE;
const DEFAULT_HEIGHT: f32 = 1.0;
const DEFAULT_PRIMVAR: &str = "st";

/// How many tiles a tile's geometry may reach beyond its own.
const REACH: f32 = 4.0;

/// How far from 0 a tile's z may be.
const HIGHEST: f32 = 1e6;

impl Reader {
    /// What stands over a surface, if anything does.
    pub(super) fn tiles(
        &mut self,
        prim: &Prim,
        names: &[Token],
        geometry: &Geometry,
        unusable: &[UnusablePrimvar],
    ) -> Result<Option<Tiles>, Fault> {
        let applied = prim.has_api_schema(API).unwrap_or(false);
        if !applied && !has(names, TILE) {
            return Ok(None);
        }
        let target = match self.targets(prim, TILE).as_slice() {
            [target] => target.clone(),
            // A layer above may take the target away.
            [] if !applied => return Ok(None),
            [] => {
                return Err(
                    Fault::new(format!("{API} is applied, and {TILE} has no target")).advise(
                        format!(
                            "author rel {TILE} with the path of a Mesh, or do not apply the schema"
                        ),
                    ),
                );
            }
            targets => {
                let targets: Vec<&str> = targets.iter().map(sdf::Path::as_str).collect();
                return Err(Fault::new(format!(
                    "{TILE} has {} targets: {}",
                    targets.len(),
                    targets.join(", ")
                ))
                .advise("leave one of them; what is to stand in one tile belongs into one mesh"));
            }
        };
        let repeats = self.repeats(prim)?;
        let height = self.height(prim)?;
        let primvar = match self.value(prim, PRIMVAR) {
            None => DEFAULT_PRIMVAR.to_owned(),
            Some(value) => value::word(value).ok_or_else(|| {
                Fault::new(format!("{PRIMVAR} is no token"))
                    .advise(format!("author token {PRIMVAR} with the name of a primvar"))
            })?,
        };
        check_primvar(&primvar, geometry, unusable)?;
        let (path, mesh) = self.tile(&target)?;
        Ok(Some(Tiles {
            path,
            mesh,
            primvar,
            repeats,
            height,
        }))
    }

    fn repeats(&self, prim: &Prim) -> Result<Vec2, Fault> {
        let Some(value) = self.value(prim, REPEATS) else {
            return Ok(DEFAULT_REPEATS);
        };
        let help = "author two finite numbers above 0: tiles for a unit of s and of t";
        let repeats = value::floats(value)
            .filter(|f| f.width == 2 && f.values.len() == 2)
            .map(|f| Vec2::from_slice(&f.values))
            .ok_or_else(|| Fault::new(format!("{REPEATS} is no float2")).advise(help))?;
        if repeats.is_finite() && repeats.min_element() > 0.0 {
            Ok(repeats)
        } else {
            let Vec2 { x, y } = repeats;
            Err(Fault::new(format!("{REPEATS} is ({x}, {y})")).advise(help))
        }
    }

    fn height(&self, prim: &Prim) -> Result<f32, Fault> {
        let Some(value) = self.value(prim, HEIGHT) else {
            return Ok(DEFAULT_HEIGHT);
        };
        let help = "author a finite number above 0: how high a z of 1 is, in units of the surface's points";
        let height = value::number(&value)
            .ok_or_else(|| Fault::new(format!("{HEIGHT} is no number")).advise(help))?;
        let height = height as f32;
        if height.is_finite() && height > 0.0 {
            Ok(height)
        } else {
            Err(Fault::new(format!("{HEIGHT} is {height}")).advise(help))
        }
    }

    /// A tile's path and polygons, shared by all surfaces that it stands over.
    fn tile(&mut self, target: &sdf::Path) -> Result<(String, Arc<ControlMesh>), Fault> {
        let gone = |what: &str| {
            Fault::new(format!("the tile {target} {what}")).advise(format!(
                "{TILE} must lead to a Mesh; it may be below a class"
            ))
        };
        let prim = (self.stage.prim(target.clone()).ok())
            .filter(|p| p.is_valid().unwrap_or(false))
            .ok_or_else(|| gone("is not there"))?;
        if !prim.is_active().unwrap_or(false) {
            return Err(gone("is not active"));
        }
        match self.type_name(&prim).as_str() {
            "Mesh" => {}
            "" => return Err(gone("has no type")),
            other => return Err(gone(&format!("is of type {other}"))),
        }
        let path = prim.prim_in_prototype().ok().flatten().map_or_else(
            || target.as_str().to_owned(),
            |p| p.path().as_str().to_owned(),
        );
        if let Some(known) = self.tile_of.get(&path) {
            return Ok((path, known.clone()));
        }
        let mesh = self.tile_mesh(&prim).map_err(|mut fault| {
            let help = || "repair the tile's mesh where it is exported".into();
            fault.help.get_or_insert_with(help);
            // The fault's own place is the surface's.
            let face = fault.face.take().map(|f| format!(", face {f}"));
            fault.message = format!(
                "the tile {path}{}: {}",
                face.unwrap_or_default(),
                fault.message
            );
            fault
        })?;
        let mesh = Arc::new(mesh);
        self.tile_of.insert(path.clone(), mesh.clone());
        Ok((path, mesh))
    }

    fn tile_mesh(&mut self, prim: &Prim) -> Result<ControlMesh, Fault> {
        let path = prim.path().as_str().to_owned();
        let counts = self.integers(prim, "faceVertexCounts");
        if counts.is_empty() {
            return Err(Fault::new("the mesh has no faces").advise("author faceVertexCounts"));
        }
        // Where nothing is authored, it is catmullClark.
        let scheme = self.word(prim, "subdivisionScheme").unwrap_or_default();
        if scheme != "none" {
            return Err(Fault::new(format!("subdivisionScheme is {scheme}"))
                .advise("author uniform token subdivisionScheme = \"none\" on the tile: it has to be polygons"));
        }
        let corners = self.integers(prim, "faceVertexIndices");
        let points = self
            .value(prim, "points")
            .and_then(value::vectors)
            .unwrap_or_default();
        if points.is_empty() {
            return Err(self.no_points(prim));
        }
        let mesh = ControlMesh {
            scheme: Scheme::None,
            face_vertex_counts: to_u32(counts, || "faceVertexCounts hold".into())?,
            face_vertex_indices: to_u32(corners, || "faceVertexIndices hold".into())?,
            points: vec![points],
            holes: to_u32(self.integers(prim, "holeIndices"), || {
                "holeIndices hold".into()
            })?,
            left_handed: self.word(prim, "orientation").as_deref() == Some("leftHanded"),
            ..ControlMesh::default()
        };
        mesh.validate()?;
        if !mesh.has_area() {
            return Err(Fault::new("no face has an area").advise("give its faces corners apart"));
        }
        let within = -REACH..=1.0 + REACH;
        if let Some(point) =
            (mesh.used_points()).find(|p| !within.contains(&p.x) || !within.contains(&p.y))
        {
            return Err(Fault::new(format!(
                "it reaches to ({}, {}), more than {REACH} tiles beyond 0..1",
                point.x, point.y
            ))
            .advise("scale its points, not its transform: one tile is x and y from 0 to 1"));
        }
        if let Some(point) = mesh
            .used_points()
            .find(|p| !(0.0..=HIGHEST).contains(&p.z.abs()))
        {
            return Err(Fault::new(format!(
                "it reaches to z = {}, farther than {HIGHEST}",
                point.z
            ))
            .advise("scale its points, and author relievo:shell:height for it"));
        }
        let names = self.authored(prim);
        let unread = |name: &str| {
            name == "normals"
                || ["primvars:", "material:binding", "xformOp:"]
                    .iter()
                    .any(|start| name.starts_with(start))
        };
        if let Some(name) = names.iter().find(|name| unread(name.as_str())) {
            self.warn("what a tile carries", || {
                format!(
                    "{path}.{}: of a tile only faces and points are read; material and primvars are those of the surface below",
                    name.as_str()
                )
            });
        }
        Ok(mesh)
    }
}

/// Whether tiles can lie by this primvar of the surface.
fn check_primvar(
    name: &str,
    geometry: &Geometry,
    unusable: &[UnusablePrimvar],
) -> Result<(), Fault> {
    let help = format!(
        "author texCoord2f[] primvars:{name}, vertex, varying or faceVarying, or name another primvar by token {PRIMVAR}"
    );
    if let Some(left_out) = unusable.iter().find(|p| p.name == name) {
        return Err(Fault::new(format!(
            "tiles lie by its primvar {name}, which cannot be used: {}",
            left_out.fault.message
        ))
        .advise(help));
    }
    let wrong = match geometry.primvar(name) {
        // The parameters of a patch are its texture coordinates.
        None if name == "st" && matches!(geometry, Geometry::Nurbs(_)) => return Ok(()),
        None => "it has none of that name".into(),
        Some(p) if p.width != 2 => format!("that has {} components where two are needed", p.width),
        Some(p) => match p.interpolation {
            Interpolation::Constant => "that is constant".into(),
            Interpolation::Uniform => "that is constant over each face".into(),
            Interpolation::Varying | Interpolation::Vertex | Interpolation::FaceVarying => {
                return Ok(());
            }
        },
    };
    Err(Fault::new(format!("tiles lie by its primvar {name}, and {wrong}")).advise(help))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::scene::usd::tests::{kinds, read, refused};

    const SURFACE: &str = "int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]";
    const ST: &str =
        "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"vertex\")";
    const TARGET: &str = "rel relievo:shell:tile = </Tiles/Blade>";

    /// A tile below a class; `more` comes after what it needs.
    fn tile(more: &str) -> String {
        format!(
            "class \"Tiles\" {{ def Mesh \"Blade\" {{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0.4, 0.5, -0.25), (0.6, 0.5, 0), (1.5, 0.5, 1)]
    {more} }} }}\n"
        )
    }

    const POLYGONS: &str = "uniform token subdivisionScheme = \"none\"";

    #[test]
    fn everything_is_read_of_a_shell() {
        let scene = read(&format!(
            "{}
def Mesh \"Whole\" (prepend apiSchemas = [\"RelievoShellAPI\"]) {{ {SURFACE}
    texCoord2f[] primvars:uv = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = \"faceVarying\")
    {TARGET}
    float2 relievo:shell:repeats = (20, 0.5)
    float relievo:shell:height = 0.125
    token relievo:shell:primvar = \"uv\" }}
def Mesh \"NotApplied\" {{ {SURFACE}
    {ST}
    {TARGET} }}
def Sphere \"Round\" (prepend apiSchemas = [\"RelievoShellAPI\"]) {{ {TARGET} }}
def Mesh \"TakenAway\" {{ {SURFACE}
    rel relievo:shell:tile = None }}
def Mesh \"Plain\" {{ {SURFACE} }}",
            tile(&format!(
                "{POLYGONS}
    uniform token orientation = \"leftHanded\"
    double3 xformOp:translate = (7, 7, 7)
    uniform token[] xformOpOrder = [\"xformOp:translate\"]"
            ))
        ));
        assert_eq!(kinds(&scene), ["what a tile carries"]);
        let paths: Vec<&str> = scene.placements.iter().map(|p| p.path.as_str()).collect();
        assert_eq!(
            paths,
            ["/Whole", "/NotApplied", "/Round", "/TakenAway", "/Plain"]
        );
        let tiles = |i: usize| scene.shapes[i].tiles.as_ref();
        let whole = tiles(0).expect("tiles");
        assert_eq!(whole.path, "/Tiles/Blade");
        assert_eq!((whole.primvar.as_str(), whole.height), ("uv", 0.125));
        assert_eq!(whole.repeats, Vec2::new(20.0, 0.5));
        assert!(whole.mesh.left_handed && whole.mesh.scheme == Scheme::None);
        assert_eq!(whole.mesh.points[0][2], Vec3::new(1.5, 0.5, 1.0));
        for i in [1, 2] {
            let tiles = tiles(i).expect("tiles");
            assert_eq!((tiles.primvar.as_str(), tiles.height), ("st", 1.0));
            assert_eq!(tiles.repeats, Vec2::ONE);
            assert!(Arc::ptr_eq(&tiles.mesh, &whole.mesh));
        }
        assert!(tiles(3).is_none() && tiles(4).is_none());
    }

    #[test]
    fn a_tile_that_moves_is_that_of_the_frame() {
        let points = |x: f32| format!("[({x}, 0, 0), (1, 0, 0), (0, 1, 0)]");
        let scene = read(&format!(
            "(\n    startTimeCode = 1\n)
def Camera \"C\" {{ double shutter:close = 1 }}
def Scope \"Tiles\" {{ token visibility = \"invisible\"
    def Mesh \"Blade\" {{ {POLYGONS}
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points.timeSamples = {{ 0: {}, 2: {} }} }} }}
def Mesh \"M\" {{ {SURFACE}
    {ST}
    {TARGET} }}",
            points(0.0),
            points(0.5)
        ));
        assert_eq!((scene.placements.len(), scene.shapes.len()), (1, 1));
        let tiles = scene.shapes[0].tiles.as_ref().expect("tiles");
        assert_eq!(tiles.mesh.points.len(), 1);
        assert_eq!(tiles.mesh.points[0][0].x, 0.25);
    }

    #[test]
    fn surfaces_are_told_apart_by_their_tiles() {
        let other = tile(POLYGONS).replace("\"Tiles\"", "\"Others\"");
        let scene = read(&format!(
            "{}{other}
class \"Bare\" {{ def Mesh \"M\" {{ {SURFACE}
    {ST} }} }}
class \"Hairy\" (inherits = </Bare>) {{ over \"M\" {{ {TARGET} }} }}
class \"Scaly\" (inherits = </Bare>) {{ over \"M\" {{ rel relievo:shell:tile = </Others/Blade> }} }}
def \"A\" (instanceable = true
    inherits = </Hairy>) {{ }}
def \"B\" (instanceable = true
    inherits = </Scaly>) {{ }}
def \"C\" (instanceable = true
    inherits = </Hairy>) {{ double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = [\"xformOp:translate\"] }}
def \"D\" (instanceable = true
    inherits = </Bare>) {{ }}",
            tile(POLYGONS)
        ));
        let of = |i: usize| scene.placements[i].shape;
        assert_eq!((scene.shapes.len(), of(0)), (3, of(2)));
        let tile = |i: usize| scene.shapes[of(i)].tiles.as_ref().map(|t| t.path.as_str());
        assert_eq!(
            [tile(0), tile(1), tile(3)],
            [Some("/Tiles/Blade"), Some("/Others/Blade"), None]
        );
    }

    #[test]
    fn what_is_wrong_with_a_shell_is_named() {
        let applied = "(prepend apiSchemas = [\"RelievoShellAPI\"])";
        let (good, ordinary) = (tile(POLYGONS), format!("{ST}\n{TARGET}"));
        let with = |more: &str| format!("{ordinary}\n{more}");
        let spoilt = |from: &str, to: &str| {
            assert!(good.contains(from), "{from}");
            good.replace(from, to)
        };
        let faces = "[3]\n    int[] faceVertexIndices = [0, 1, 2]";
        for (tile, surface, message) in [
            (good.clone(), ST.into(), "relievo:shell:tile has no target"),
            (
                good.clone(),
                format!("{ST}\nrel relievo:shell:tile = [</Tiles/Blade>, </Tiles>]"),
                "has 2 targets: /Tiles/Blade, /Tiles",
            ),
            (
                String::new(),
                ordinary.clone(),
                "the tile /Tiles/Blade is not there",
            ),
            (
                spoilt("def Mesh", "def Xform"),
                ordinary.clone(),
                "the tile /Tiles/Blade is of type Xform",
            ),
            (
                spoilt("def Mesh", "def"),
                ordinary.clone(),
                "the tile /Tiles/Blade has no type",
            ),
            (
                spoilt("\"Blade\"", "\"Blade\" (active = false)"),
                ordinary.clone(),
                "the tile /Tiles/Blade is not active",
            ),
            (
                tile(""),
                ordinary.clone(),
                "the tile /Tiles/Blade: subdivisionScheme is catmullClark",
            ),
            (
                spoilt("\"none\"", "\"loop\""),
                ordinary.clone(),
                "the tile /Tiles/Blade: subdivisionScheme is loop",
            ),
            (
                spoilt(faces, "[]"),
                ordinary.clone(),
                "the tile /Tiles/Blade: the mesh has no faces",
            ),
            (
                spoilt("point3f[] points", "point3f[] others"),
                ordinary.clone(),
                "the tile /Tiles/Blade: the mesh has faces and no points",
            ),
            (
                spoilt("[0, 1, 2]", "[0, 1, 7]"),
                ordinary.clone(),
                "the tile /Tiles/Blade, face 0: index 7, but there are 3 points",
            ),
            (
                spoilt("[0, 1, 2]", "[0, 1, 1]"),
                ordinary.clone(),
                "the tile /Tiles/Blade: no face has an area",
            ),
            (
                spoilt("(1.5, 0.5, 1)", "(0, 5.5, 1)"),
                ordinary.clone(),
                "the tile /Tiles/Blade: it reaches to (0, 5.5), more than 4 tiles beyond 0..1",
            ),
            (
                spoilt("(1.5, 0.5, 1)", "(-4.25, 0, 1)"),
                ordinary.clone(),
                "it reaches to (-4.25, 0)",
            ),
            (
                spoilt("(1.5, 0.5, 1)", "(1.5, 0.5, -2e6)"),
                ordinary.clone(),
                "it reaches to z = -2000000",
            ),
            (
                good.clone(),
                with("float2 relievo:shell:repeats = (3, 0)"),
                "relievo:shell:repeats is (3, 0)",
            ),
            (
                good.clone(),
                with("float2 relievo:shell:repeats = (nan, 1)"),
                "relievo:shell:repeats is (NaN, 1)",
            ),
            (
                good.clone(),
                with("float relievo:shell:repeats = 3"),
                "relievo:shell:repeats is no float2",
            ),
            (
                good.clone(),
                with("float relievo:shell:height = -1"),
                "relievo:shell:height is -1",
            ),
            (
                good.clone(),
                with("float relievo:shell:height = inf"),
                "relievo:shell:height is inf",
            ),
            (
                good.clone(),
                with("string relievo:shell:height = \"low\""),
                "relievo:shell:height is no number",
            ),
            (
                good.clone(),
                with("int relievo:shell:primvar = 1"),
                "relievo:shell:primvar is no token",
            ),
            (
                good.clone(),
                with("token relievo:shell:primvar = \"map1\""),
                "tiles lie by its primvar map1, and it has none of that name",
            ),
            (
                good.clone(),
                format!(
                    "{TARGET}\nfloat3[] primvars:st = [(0, 0, 0)] (interpolation = \"constant\")"
                ),
                "primvar st, and that has 3 components",
            ),
            (
                good.clone(),
                format!("{TARGET}\nfloat2[] primvars:st = [(0, 0)] (interpolation = \"uniform\")"),
                "primvar st, and that is constant over each face",
            ),
            (
                good.clone(),
                format!("{TARGET}\nfloat2[] primvars:st = [(0, 0)] (interpolation = \"vertex\")"),
                "primvar st, which cannot be used: primvar st has 1 elements for 4 points",
            ),
        ] {
            let fault = refused(&format!(
                "{tile}def Mesh \"Bad\" {applied} {{ {SURFACE}\n{surface}\n}}"
            ));
            assert!(fault.message.contains(message), "{message}: {fault}");
            assert_eq!(fault.prim.as_deref(), Some("/Bad"));
            assert!(fault.file.is_some() && fault.help.is_some(), "{fault:?}");
        }
    }

    #[test]
    fn the_schema_says_the_same() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/schema/schema.usda");
        let stage = openusd::usd::Stage::builder().open(file).expect("a stage");
        let schema = stage.prim("/RelievoShellAPI").expect("a class");
        let value = |name: &str| {
            schema
                .attribute(name)
                .get::<sdf::Value>()
                .expect("an attribute")
                .expect("a default")
        };
        let mut names: Vec<String> = (schema.authored_property_names().expect("names").iter())
            .map(|n| n.as_str().to_owned())
            .collect();
        names.sort();
        assert_eq!(names, [HEIGHT, PRIMVAR, REPEATS, TILE]);
        let repeats = value::floats(value(REPEATS)).map(|f| f.values);
        assert_eq!(repeats, Some(DEFAULT_REPEATS.to_array().to_vec()));
        assert_eq!(
            value::number(&value(HEIGHT)),
            Some(f64::from(DEFAULT_HEIGHT))
        );
        assert_eq!(
            value::word(value(PRIMVAR)).as_deref(),
            Some(DEFAULT_PRIMVAR)
        );
        assert_eq!(schema.path().name(), Some(API));
    }
}
