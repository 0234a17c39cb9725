//! Ways of tracing a surface: their names, how each is built, and from its hits back to the face.

use std::sync::Arc;

use crate::accel::{
    Accuracy, Cache, CacheSize, Cached, Compact, CompactOptions, Compressed, Copies, Dbvh,
    DbvhOptions, Intersector, Keep, MaxError, Nonlinear, Stored, Tessellated, Tiled, Trimmed,
};
use crate::error::Result;
use crate::math::Vec2;
use crate::stats::AchievedError;
use crate::store::Sections;
use crate::surface::{Diced, Grids, Rates, Surface, Tiles};
use crate::trace::{
    Device, Geometry, SceneHit, SceneOptions, caught, diced_grid_uv, diced_triangle_uv,
};

/// A way of tracing a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Embree's own subdivision geometry.
    EmbreeSubdivision,
    /// Our micro-triangles as Embree's triangles.
    EmbreeTriangles,
    /// Our micro-triangles as Embree's grids. The default: a tenth slower than triangles in a sixth of their memory.
    #[default]
    EmbreeGrid,
    /// The same grids in trees that Embree builds for little memory.
    EmbreeGridCompact,
    /// Our micro-triangles in a plain tree of our own.
    Tessellated,
    /// Our micro-triangles quantised, in trees without pointers.
    Compact,
    /// Thin slabs around a few of our micro-triangles each, in trees without pointers.
    Compressed,
    /// What the quantised micro-triangles are, diced when rays come to them, in a cache of fixed size.
    Cache,
    /// Micro-triangles that are computed where rays pass, of a surface as few quads and an image.
    Dbvh,
    /// Heights over prisms, traced by bent rays.
    Nonlinear,
}

/// How the surfaces of a scene are traced.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// All of them by one method.
    One(Method),
    /// Each by the first of Embree's triangles, `compact` and `cache` that fits into memory together with all others.
    Auto,
}

impl Choice {
    /// Its name on the command line and in reports: the method's, or `auto`.
    pub fn name(self) -> &'static str {
        match self {
            Self::One(method) => method.name(),
            Self::Auto => "auto",
        }
    }

    /// What it is, in a line.
    pub fn about(self) -> &'static str {
        match self {
            Self::One(method) => method.about(),
            Self::Auto => {
                "each object by the first of embree-triangles, compact and cache that fits into memory"
            }
        }
    }

    /// How Embree is to build the scenes that its geometries are in.
    pub fn scene_options(self) -> SceneOptions {
        match self {
            Self::One(method) => method.scene_options(),
            Self::Auto => Method::EmbreeTriangles.scene_options(),
        }
    }
}

impl Default for Choice {
    fn default() -> Self {
        Self::One(Method::default())
    }
}

impl From<Method> for Choice {
    fn from(method: Method) -> Self {
        Self::One(method)
    }
}

/// A surface built for a method.
pub struct TracedSurface {
    /// What Embree traces.
    pub geometry: Geometry,
    /// How a hit tells where on the surface it is.
    pub places: HitPlaces,
    /// Bytes held beside Embree's.
    pub bytes: usize,
    /// How far the method moved micro-vertices, if it did.
    pub accuracy: Option<Accuracy>,
    /// How thick the slabs are that the method has instead of micro-triangles, or how far its own surface is from the
    /// displaced limit surface, if it has one.
    pub thick: Option<AchievedError>,
}

impl TracedSurface {
    /// How far hits may be from the micro-triangles as they were diced, if they may, by the object's size and in pixels:
    /// how far the method moved micro-vertices, or how thick its slabs are.
    pub fn error(&self) -> Option<AchievedError> {
        self.thick
            .or(self.accuracy.as_ref().map(Accuracy::achieved))
    }
}

/// How a surface is to be built.
pub struct How<'a> {
    /// The farthest that a method which compresses may move a micro-vertex.
    pub max_error: MaxError,
    /// Where what is diced while rays are traced goes, of all surfaces.
    pub cache: &'a Arc<Cache>,
    /// Told how far it is, 0..1; ends it by false.
    pub go_on: &'a dyn Fn(f64) -> bool,
    /// Takes what is built, if the method [is stored](Method::is_stored).
    pub keep: Option<&'a mut Keep<'a>>,
}

/// From a hit to the face, and the parameters on it.
pub enum HitPlaces {
    /// The hit's primitive is a micro-triangle.
    Triangles(Arc<Grids>),
    /// The hit's primitive is a grid.
    Grids(Arc<Grids>),
    /// The hit has them itself.
    OfHit,
    /// The hit has some that are near: it stands for a piece of the surface.
    NearHit,
    /// The hit has those of the place below it: what was met stands over the surface.
    BelowHit,
    /// The same, and the hit's primitive is one of these triangles.
    BelowCopies(Arc<Copies>),
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::EmbreeSubdivision,
        Self::EmbreeTriangles,
        Self::EmbreeGrid,
        Self::EmbreeGridCompact,
        Self::Tessellated,
        Self::Compact,
        Self::Compressed,
        Self::Cache,
        Self::Dbvh,
        Self::Nonlinear,
    ];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::EmbreeSubdivision => "embree-subdivision",
            Self::EmbreeTriangles => "embree-triangles",
            Self::EmbreeGrid => "embree-grid",
            Self::EmbreeGridCompact => "embree-grid-compact",
            Self::Tessellated => "tessellated",
            Self::Compact => "compact",
            Self::Compressed => "compressed",
            Self::Cache => "cache",
            Self::Dbvh => "dbvh",
            Self::Nonlinear => "nonlinear",
        }
    }

    /// What it is, in a line.
    pub fn about(self) -> &'static str {
        match self {
            Self::EmbreeSubdivision => "Embree's subdivision surfaces, displaced by its callback",
            Self::EmbreeTriangles => {
                "micro-triangles in Embree: a tenth faster than grids, six times their memory"
            }
            Self::EmbreeGrid => "micro-triangles as Embree's grids",
            Self::EmbreeGridCompact => "the same grids in Embree's compact trees: a sixth smaller",
            Self::Tessellated => "micro-triangles in a plain tree of our own: slow",
            Self::Compact => "micro-triangles at about a byte each, in trees of our own",
            Self::Compressed => {
                "thin slabs around a few micro-triangles each, at about half a byte for one"
            }
            Self::Cache => {
                "the micro-triangles of compact, diced when rays come to them, in a cache of fixed size"
            }
            Self::Dbvh => "micro-triangles computed where rays pass, from few quads and the image",
            Self::Nonlinear => "heights over prisms, traced by bent rays: no micro-triangles",
        }
    }

    /// The cache for all surfaces of a scene: of this size for the method that has one.
    pub fn cache(self, size: CacheSize) -> Arc<Cache> {
        Arc::new(Cache::new(if self == Self::Cache { size.0 } else { 0 }))
    }

    /// How Embree is to build the scenes that its geometries are in.
    pub fn scene_options(self) -> SceneOptions {
        SceneOptions {
            robust: true,
            compact: self == Self::EmbreeGridCompact,
        }
    }

    /// Whether what it builds can be kept in a [`Store`](crate::store::Store).
    pub fn is_stored(self) -> bool {
        matches!(self, Self::Compact | Self::Compressed)
    }

    /// Whether hits lie on the micro-triangles that the dicing rates ask for, or as near to them as
    /// [`TracedSurface::accuracy`] says. Only then may paths that have bounced see others: see
    /// [`BuildOptions::bounce_dicing`](super::BuildOptions::bounce_dicing).
    pub fn is_diced(self) -> bool {
        match self {
            Self::EmbreeTriangles
            | Self::EmbreeGrid
            | Self::EmbreeGridCompact
            | Self::Tessellated
            | Self::Compact
            | Self::Cache => true,
            Self::EmbreeSubdivision | Self::Compressed | Self::Dbvh | Self::Nonlinear => false,
        }
    }

    /// By what a surface is traced where this method is asked for: if it [is even](Surface::is_even_everywhere), by its
    /// faces' own triangles, as polygons are. Embree's subdivision sees to that itself.
    #[must_use]
    pub fn on(self, surface: &Surface) -> Self {
        if self != Self::EmbreeSubdivision && is_few_triangles(surface) {
            Self::EmbreeTriangles
        } else {
            self
        }
    }

    /// What was built of a surface, from a store.
    ///
    /// # Errors
    /// If it is not what the method builds of such a surface, or Embree fails.
    ///
    /// # Panics
    /// If the method [is not stored](Self::is_stored).
    pub fn stored(
        self,
        surface: &Arc<Surface>,
        device: &Device,
        sections: &Sections<'_>,
    ) -> Result<TracedSurface> {
        let traced = match self {
            Self::Compact => {
                let tree = Compact::stored(surface, sections)?;
                let accuracy = Some(tree.accuracy());
                (of_hit(tree, surface, device)?, accuracy, None)
            }
            Self::Compressed => {
                let tree = Compressed::stored(surface, sections)?;
                let thick = Some(tree.achieved());
                (near_hit(tree, surface, device)?, None, thick)
            }
            _ => panic!("{} is not stored", self.name()),
        };
        let ((geometry, places, bytes), accuracy, thick) = traced;
        Ok(TracedSurface {
            geometry,
            places,
            bytes,
            accuracy,
            thick,
        })
    }

    /// Builds a surface. Embree's subdivision knows control meshes, but not our surfaces: under its name they become
    /// Embree's triangles.
    ///
    /// # Errors
    /// If there are more micro-triangles than the method can number, or memory runs out; if it is ended; if an error in
    /// pixels is asked for, and the rates know of none; if the displacement panics.
    pub fn build(
        self,
        surface: &Arc<Surface>,
        rates: &Rates,
        device: &Device,
        how: How<'_>,
    ) -> Result<TracedSurface> {
        caught("a surface was built", || {
            self.built(surface, rates, device, how)
        })
    }

    fn built(
        self,
        surface: &Arc<Surface>,
        rates: &Rates,
        device: &Device,
        how: How<'_>,
    ) -> Result<TracedSurface> {
        if let Some(tiles) = surface.tiles() {
            return self.tiled(surface, tiles, device, how.go_on);
        }
        let (mut accuracy, mut thick) = (None, None);
        let diced = || Diced::watched(surface, rates, how.go_on).map(Arc::new);
        let (geometry, places, bytes) = match self {
            Self::EmbreeSubdivision | Self::EmbreeTriangles => {
                let diced = diced()?;
                let grids = diced.shared_grids().clone();
                let bytes = grids.memory();
                let geometry = Geometry::diced_triangles(device, &diced)?;
                (geometry, HitPlaces::Triangles(grids), bytes)
            }
            Self::EmbreeGrid | Self::EmbreeGridCompact => {
                let diced = diced()?;
                let grids = diced.shared_grids().clone();
                let bytes = grids.memory();
                let geometry = Geometry::diced_grids(device, &diced)?;
                (geometry, HitPlaces::Grids(grids), bytes)
            }
            Self::Tessellated => {
                of_hit(Tessellated::watched(diced()?, how.go_on)?, surface, device)?
            }
            Self::Compact => {
                // It dices by itself, a few rows at a time.
                let options = CompactOptions {
                    max_error: how.max_error,
                };
                let tree = Compact::build(surface, rates, &options, how.go_on)?;
                accuracy = Some(tree.accuracy());
                if let Some(keep) = how.keep {
                    tree.store(keep)?;
                }
                of_hit(tree, surface, device)?
            }
            Self::Compressed => {
                let tree = Compressed::build(surface, rates, how.go_on)?;
                thick = Some(tree.achieved());
                if let Some(keep) = how.keep {
                    tree.store(keep)?;
                }
                near_hit(tree, surface, device)?
            }
            Self::Cache => {
                let tree = Cached::build(surface, rates, how.max_error, how.cache, how.go_on)?;
                accuracy = Some(tree.accuracy());
                of_hit(tree, surface, device)?
            }
            Self::Dbvh => {
                let tree = Dbvh::build(surface, rates, &DbvhOptions::default(), how.go_on)?;
                thick = Some(tree.achieved());
                of_hit(tree, surface, device)?
            }
            Self::Nonlinear => {
                let tree = Nonlinear::build(surface, rates, how.go_on)?;
                thick = Some(tree.achieved());
                of_hit(tree, surface, device)?
            }
        };
        let geometry = places.trimmed(geometry, surface);
        Ok(TracedSurface {
            geometry,
            places,
            bytes,
            accuracy,
            thick,
        })
    }
}

impl Method {
    /// Whether what stands over a surface, tile by tile, is copied into Embree for each of them, and not traced by bent rays.
    pub fn copies_tiles(self) -> bool {
        matches!(self, Self::EmbreeTriangles | Self::EmbreeSubdivision)
    }

    /// What stands over a surface.
    fn tiled(
        self,
        surface: &Arc<Surface>,
        tiles: &Arc<Tiles>,
        device: &Device,
        go_on: &dyn Fn(f64) -> bool,
    ) -> Result<TracedSurface> {
        // Copies take longest.
        let first = if self.copies_tiles() { 0.2 } else { 1.0 };
        let tiled = Tiled::build(surface, tiles, &|done| go_on(first * done))?;
        let thick = Some(tiled.achieved());
        let (geometry, places, bytes) = if self.copies_tiles() {
            let mut copies = tiled.copies(&|done| go_on(first + (1.0 - first) * done))?;
            let geometry = Geometry::copies(device, &copies)?;
            // Embree has its own.
            copies.positions = Vec::new();
            let bytes = copies.memory();
            (geometry, HitPlaces::BelowCopies(Arc::new(copies)), bytes)
        } else {
            let (geometry, _, bytes) = of_hit(tiled, surface, device)?;
            (geometry, HitPlaces::BelowHit, bytes)
        };
        Ok(TracedSurface {
            geometry: places.trimmed(geometry, surface),
            places,
            bytes,
            accuracy: None,
            thick,
        })
    }
}

/// Whether a surface is but two triangles a face, and nothing stands over it.
pub(super) fn is_few_triangles(surface: &Surface) -> bool {
    surface.tiles().is_none() && surface.is_even_everywhere()
}

/// A method of our own on what is kept of a surface.
fn of_hit<I: Intersector + 'static>(
    method: I,
    surface: &Arc<Surface>,
    device: &Device,
) -> Result<(Geometry, HitPlaces, usize)> {
    let bytes = method.memory();
    let geometry = if surface.base().is_trimmed() {
        Geometry::user(device, Arc::new(Trimmed::new(method, surface.clone())))?
    } else {
        Geometry::user(device, Arc::new(method))?
    };
    Ok((geometry, HitPlaces::OfHit, bytes))
}

/// The same where hits are near the surface only.
fn near_hit<I: Intersector + 'static>(
    method: I,
    surface: &Arc<Surface>,
    device: &Device,
) -> Result<(Geometry, HitPlaces, usize)> {
    let (geometry, _, bytes) = of_hit(method, surface, device)?;
    Ok((geometry, HitPlaces::NearHit, bytes))
}

impl HitPlaces {
    /// The face of the surface's base and the parameters on it.
    ///
    /// # Panics
    /// If the hit is on another geometry.
    pub fn face_uv(&self, hit: &SceneHit) -> (u32, Vec2) {
        match self {
            Self::Triangles(grids) => diced_triangle_uv(grids, hit.primitive, hit.uv),
            Self::Grids(grids) => diced_grid_uv(grids, hit.primitive, hit.uv),
            Self::OfHit | Self::NearHit | Self::BelowHit => (hit.face, hit.uv),
            Self::BelowCopies(copies) => copies.face_uv(hit.primitive, hit.uv),
        }
    }

    /// Whether what was hit stands over the surface, and not on it.
    pub fn are_below(&self) -> bool {
        matches!(self, Self::BelowHit | Self::BelowCopies(_))
    }

    /// Embree's geometry of a surface with only the hits that are on its kept part.
    fn trimmed(&self, mut geometry: Geometry, surface: &Arc<Surface>) -> Geometry {
        if surface.base().is_trimmed() {
            let surface = surface.clone();
            let is_kept = move |(face, uv): (u32, Vec2)| surface.base().is_kept(face, uv);
            match self {
                Self::Triangles(grids) => {
                    let grids = grids.clone();
                    geometry.filter(Arc::new(move |primitive, uv| {
                        is_kept(diced_triangle_uv(&grids, primitive, uv))
                    }));
                }
                Self::Grids(grids) => {
                    let grids = grids.clone();
                    geometry.filter(Arc::new(move |primitive, uv| {
                        is_kept(diced_grid_uv(&grids, primitive, uv))
                    }));
                }
                Self::BelowCopies(copies) => {
                    let copies = copies.clone();
                    geometry.filter(Arc::new(move |primitive, uv| {
                        is_kept(copies.face_uv(primitive, uv))
                    }));
                }
                Self::OfHit | Self::NearHit | Self::BelowHit => {}
            }
        }
        geometry
    }
}
