//! What a scene file says, composed and resolved at one frame: plain data without any file handle.
//!
//! All lengths are in scene units, all transforms lead to the world of the file as it stands: the up axis is
//! not rotated away, because nothing in a picture depends on it but the framing of a bare mesh. Colours are
//! linear with Rec.709 primaries. Where something moves there are several *motion keys*, evenly spaced from
//! shutter open (first) to shutter close (last); one key says that it stands still.

use std::path::PathBuf;
use std::sync::Arc;

use crate::error::{Fault, Warnings};
pub use crate::image::{ColorSpace, ImageSource, PtexFilter, PtexOptions, Wrap};
use crate::math::{Bounds3, DAffine3, Vec2, Vec3, Vec4};
use crate::mesh::{ControlMesh, NurbsPatch, Primvar};

/// How to read a scene.
#[derive(Debug, Clone)]
pub struct LoadOptions {
    /// The frame; `None` takes the file's start time code, or its default values where it has no animation.
    pub frame: Option<f64>,
    /// The path or name of the camera whose shutter decides the motion keys; `None` takes the render
    /// settings' camera, else the first one.
    pub camera: Option<String>,
    /// Whether to read motion at all.
    pub motion_blur: bool,
    /// Purposes that are shown beside `default`; `None` takes the render settings' ones, else `render`.
    pub purposes: Option<Vec<Purpose>>,
    /// The render settings prim to use; `None` takes the stage's own, if it names one.
    pub settings: Option<String>,
    /// What to do about layers and prims that are referred to and not there.
    pub missing_layers: MissingLayers,
}

/// What to do where a scene's layers do not compose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MissingLayers {
    /// Stop.
    #[default]
    Error,
    /// Go on without them, with a warning.
    Skip,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            frame: None,
            camera: None,
            motion_blur: true,
            purposes: None,
            settings: None,
            missing_layers: MissingLayers::Error,
        }
    }
}

/// UsdGeomImageable's purposes other than `default`, which is always shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// For final pictures.
    Render,
    /// Stand-ins.
    Proxy,
    /// Helpers that artists see.
    Guide,
}

impl Purpose {
    /// USD's word for it; `None` for `default` and what is none.
    pub fn from_word(word: &str) -> Option<Self> {
        match word {
            "render" => Some(Self::Render),
            "proxy" => Some(Self::Proxy),
            "guide" => Some(Self::Guide),
            _ => None,
        }
    }
}

/// A whole scene.
#[derive(Debug, Clone, Default)]
pub struct Description {
    /// Every file that was read to make it, the root first.
    pub files: Vec<PathBuf>,
    /// Which way is up: Y or Z.
    pub up: Vec3,
    /// How long a scene unit is.
    pub meters_per_unit: f64,
    /// The frame that was read; `None` if the file has no animation and none was asked for.
    pub frame: Option<f64>,
    /// Frames a second, for the record.
    pub frames_per_second: f64,
    /// All cameras, in the file's order.
    pub cameras: Vec<Camera>,
    /// Shapes; each may stand in many places.
    pub shapes: Vec<Shape>,
    /// Where the shapes stand; instancing is flattened.
    pub placements: Vec<Placement>,
    /// All lights.
    pub lights: Vec<Light>,
    /// Materials; shapes and placements name them by number.
    pub materials: Vec<Material>,
    /// Textures; materials and lights name them by number.
    pub textures: Vec<TextureSource>,
    /// Ptex files; materials name them by number.
    pub ptex: Vec<PtexSource>,
    /// What UsdRender says, if anything.
    pub settings: RenderSettings,
    /// What was noticed and not honoured.
    pub warnings: Warnings,
}

/// A surface and what covers it.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The prim, or the OBJ's object or group.
    pub path: String,
    /// What the file says of the surface, checked.
    pub geometry: Geometry,
    /// Which material covers it; faces in a subset have another.
    pub materials: Binding,
    /// Whether both sides are meant to be seen.
    pub double_sided: bool,
    /// Primvars that the file gives the mesh and that do not fit it. They are not in `mesh`, and a fault once a
    /// material reads one of them.
    pub unusable_primvars: Vec<UnusablePrimvar>,
    /// What is seen in its place, if that is not the surface itself.
    pub tiles: Option<Tiles>,
}

/// Geometry that stands over a surface, tile by tile of its texture coordinates: shell mapping. The surface itself is not
/// seen.
#[derive(Debug, Clone)]
pub struct Tiles {
    /// The prim.
    pub path: String,
    /// What a tile holds, polygons: x and y run from 0 to 1 over it, along s and t, and z is above the surface. What
    /// reaches beyond 0..1 stands in the tiles beside it.
    pub mesh: Arc<ControlMesh>,
    /// The primvar of the surface that holds the texture coordinates.
    pub primvar: String,
    /// How many tiles there are for a unit of s and of t, above 0.
    pub repeats: Vec2,
    /// How high above the surface a z of 1 is, in units of the surface's points; above 0.
    pub height: f32,
}

/// A primvar that was left out.
#[derive(Debug, Clone)]
pub struct UnusablePrimvar {
    /// Its name without `primvars:`.
    pub name: String,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What a shape is made of.
#[derive(Debug, Clone)]
pub enum Geometry {
    /// A cage, or polygons.
    Mesh(Arc<ControlMesh>),
    /// A NURBS patch.
    Nurbs(Arc<NurbsPatch>),
}

impl Geometry {
    /// The mesh, if it is one.
    pub fn mesh(&self) -> Option<&Arc<ControlMesh>> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Nurbs(_) => None,
        }
    }

    /// How many faces there are: of a mesh, holes included; of a patch, polynomial pieces.
    pub fn face_count(&self) -> usize {
        match self {
            Self::Mesh(mesh) => mesh.face_count(),
            Self::Nurbs(patch) => patch.face_count(),
        }
    }

    /// How many motion keys there are.
    pub fn keys(&self) -> usize {
        match self {
            Self::Mesh(mesh) => mesh.points.len(),
            Self::Nurbs(patch) => patch.points.len(),
        }
    }

    /// The box around the points at all motion keys. Without displacement the surface lies within it.
    pub fn bounds(&self) -> Bounds3 {
        match self {
            Self::Mesh(mesh) => mesh.bounds(),
            Self::Nurbs(patch) => patch.bounds(),
        }
    }

    /// The box around the points that faces use: unused ones must not spoil a picture's framing.
    pub fn used_bounds(&self) -> Bounds3 {
        match self {
            Self::Mesh(mesh) => Bounds3::of(mesh.used_points()),
            Self::Nurbs(patch) => patch.bounds(),
        }
    }

    /// The primvar of this name.
    pub fn primvar(&self, name: &str) -> Option<&Primvar> {
        match self {
            Self::Mesh(mesh) => mesh.primvar(name),
            Self::Nurbs(patch) => patch.primvar(name),
        }
    }

    /// All primvars.
    pub fn primvars(&self) -> &[Primvar] {
        match self {
            Self::Mesh(mesh) => &mesh.primvars,
            Self::Nurbs(patch) => &patch.primvars,
        }
    }

    /// Bytes that its arrays hold.
    pub fn memory(&self) -> usize {
        match self {
            Self::Mesh(mesh) => mesh.memory(),
            Self::Nurbs(patch) => patch.memory(),
        }
    }
}

/// Which material covers which face.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Binding {
    /// The material of all faces that no subset claims; none: Lambert with the `displayColor`.
    pub whole: Option<usize>,
    /// Disjoint sets of faces with materials of their own.
    pub subsets: Vec<Subset>,
}

/// Faces with a material of their own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subset {
    /// The faces, ascending.
    pub faces: Vec<u32>,
    /// Their material.
    pub material: Option<usize>,
}

/// A shape in the world.
#[derive(Debug, Clone)]
pub struct Placement {
    /// The prim as instanced, unique: `/World/Trees/instance_17/Leaf`.
    pub path: String,
    /// Index into [`Description::shapes`].
    pub shape: usize,
    /// At each motion key; finite and invertible.
    pub world_from_object: Vec<DAffine3>,
    /// The `displayColor` that this place inherits or has of its own, over the shape's.
    pub display_color: Option<Vec3>,
    /// Replaces the shape's material for this place (a binding outside the shared prototype).
    pub material: Option<usize>,
}

/// A camera as UsdGeomCamera has it: looks down -Z, +Y up.
#[derive(Debug, Clone)]
pub struct Camera {
    /// The prim.
    pub path: String,
    /// At each motion key; finite and invertible.
    pub world_from_camera: Vec<DAffine3>,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Tenths of a scene unit, above 0.
    pub focal_length: f32,
    /// Tenths of a scene unit (orthographic: too), above 0: width and height of the film.
    pub aperture: Vec2,
    /// Tenths of a scene unit: where the film's middle lies.
    pub aperture_offset: Vec2,
    /// Near and far distance, scene units.
    pub clipping_range: Vec2,
    /// 0: everything is sharp.
    pub f_stop: f32,
    /// Scene units; 0 or less: everything is sharp.
    pub focus_distance: f32,
    /// Frames relative to the current one: open, close.
    pub shutter: [f64; 2],
    /// Stops: radiance is scaled by 2 to this.
    pub exposure: f32,
}

/// How a camera projects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Projection {
    /// Through a point.
    #[default]
    Perspective,
    /// In parallel.
    Orthographic,
}

/// A light of UsdLux.
#[derive(Debug, Clone)]
pub struct Light {
    /// The prim.
    pub path: String,
    /// Its shape. Area lights are seen by the camera and by reflections, block light, and reflect nothing.
    pub kind: LightKind,
    /// At the middle of the shutter; finite and invertible.
    pub world_from_light: DAffine3,
    /// `color` x blackbody colour if enabled x `intensity` x 2^`exposure`, at least 0.
    pub color: Vec3,
    /// UsdLux `normalize`: divide by the light's area (by the solid angle's projection for a distant one).
    pub normalize: bool,
    /// Multiplies the light's diffuse reflection.
    pub diffuse: f32,
    /// Multiplies the light's specular reflection.
    pub specular: f32,
    /// Multiplies the radiance: over the rectangle, or the dome's directions.
    pub texture: Option<TextureMap>,
    /// ShapingAPI, if applied and not without effect.
    pub shaping: Option<Shaping>,
}

/// The shape of a light. Local sizes are in the light's own space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// In the XY plane, around the origin, emitting towards -Z.
    Rect {
        /// Along X.
        width: f32,
        /// Along Y.
        height: f32,
    },
    /// In the XY plane, around the origin, emitting towards -Z.
    Disk {
        /// Its radius.
        radius: f32,
    },
    /// Around the origin, emitting outward.
    Sphere {
        /// Its radius.
        radius: f32,
    },
    /// Along the X axis, emitting outward, without caps.
    Cylinder {
        /// Its radius.
        radius: f32,
        /// Along X.
        length: f32,
    },
    /// From infinity towards -Z.
    Distant {
        /// The cone's full opening angle, degrees; 0 is a single direction.
        angle: f32,
    },
    /// From all directions; textured latitude-longitude, +Y up, in its own space.
    Dome,
}

/// UsdLuxShapingAPI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shaping {
    /// Exponent of the cosine off the axis, 0 for none.
    pub focus: f32,
    /// Colour that the focus falls off to.
    pub focus_tint: Vec3,
    /// Half opening angle in degrees; 90 and more: no cone.
    pub cone_angle: f32,
    /// 0 hard, 1 soft over the whole cone.
    pub cone_softness: f32,
}

/// A material.
#[derive(Debug, Clone)]
pub struct Material {
    /// The prim.
    pub path: String,
    /// What UsdPreviewSurface says.
    pub surface: PreviewSurface,
}

/// UsdPreviewSurface with its inputs resolved. Field names and defaults are the specification's.
#[derive(Debug, Clone)]
#[expect(
    missing_docs,
    reason = "each field is the specification's input of that name"
)]
pub struct PreviewSurface {
    pub diffuse_color: Input<Vec3>,
    pub emissive_color: Input<Vec3>,
    pub use_specular_workflow: bool,
    pub specular_color: Input<Vec3>,
    pub metallic: Input<f32>,
    pub roughness: Input<f32>,
    pub clearcoat: Input<f32>,
    pub clearcoat_roughness: Input<f32>,
    pub opacity: Input<f32>,
    pub opacity_threshold: f32,
    pub ior: Input<f32>,
    /// Tangent space, already scaled and biased to -1..1 by the map.
    pub normal: Option<NormalMap>,
    /// Along the normal, scene units in the object's space.
    pub displacement: Input<f32>,
    pub occlusion: Input<f32>,
}

impl Default for PreviewSurface {
    fn default() -> Self {
        Self {
            diffuse_color: Input::Value(Vec3::splat(0.18)),
            emissive_color: Input::Value(Vec3::ZERO),
            use_specular_workflow: false,
            specular_color: Input::Value(Vec3::ZERO),
            metallic: Input::Value(0.0),
            roughness: Input::Value(0.5),
            clearcoat: Input::Value(0.0),
            clearcoat_roughness: Input::Value(0.01),
            opacity: Input::Value(1.0),
            opacity_threshold: 0.0,
            ior: Input::Value(1.5),
            normal: None,
            displacement: Input::Value(0.0),
            occlusion: Input::Value(1.0),
        }
    }
}

/// Where the value of a material input comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Input<T> {
    /// One value.
    Value(T),
    /// A texture.
    Texture(TextureMap),
    /// A texture by faces.
    Ptex(PtexMap),
    /// A primvar of the mesh, and the value where the mesh has none.
    Primvar {
        /// Its name.
        name: String,
        /// The value without it.
        fallback: T,
    },
}

/// A texture as it lies on a surface: texel = look up (`st` moved by `transform`) x `scale` + `bias`.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureMap {
    /// Index into [`Description::textures`].
    pub texture: usize,
    /// The primvar that holds the texture coordinates.
    pub primvar: String,
    /// UsdTransform2d: scale, then rotate (degrees, counterclockwise), then translate.
    pub transform: Transform2d,
    /// Which channels the output takes.
    pub channels: Channels,
    /// Multiplies the four channels.
    pub scale: Vec4,
    /// Added to the four channels after scaling.
    pub bias: Vec4,
    /// The four channels where the texture is missing, or where the surface has no such primvar.
    pub fallback: Vec4,
}

/// Where normals come from.
#[derive(Debug, Clone, PartialEq)]
pub enum NormalMap {
    /// An image: x runs along the texture's s.
    Image(TextureMap),
    /// A Ptex file: x runs along the u of the Ptex face.
    Ptex(PtexMap),
}

/// What an input takes of a Ptex file: texel x `scale` + `bias`.
#[derive(Debug, Clone, PartialEq)]
pub struct PtexMap {
    /// Index into [`Description::ptex`].
    pub file: usize,
    /// Which channels the output takes.
    pub channels: Channels,
    /// Multiplies the four channels.
    pub scale: Vec4,
    /// Added to the four channels after scaling.
    pub bias: Vec4,
    /// The four channels where the file is missing.
    pub fallback: Vec4,
}

/// UsdTransform2d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform2d {
    /// First.
    pub scale: Vec2,
    /// Second; degrees, counterclockwise.
    pub rotation: f32,
    /// Last.
    pub translation: Vec2,
}

impl Default for Transform2d {
    fn default() -> Self {
        Self {
            scale: Vec2::ONE,
            rotation: 0.0,
            translation: Vec2::ZERO,
        }
    }
}

/// The output of a UsdUVTexture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// Three of them.
    Rgb,
    /// The first.
    R,
    /// The second.
    G,
    /// The third.
    B,
    /// The fourth.
    A,
}

/// An image to be read: two maps of one image share it if wrap and colour space agree.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureSource {
    /// Where the image is.
    pub image: ImageSource,
    /// The prim that asks for it first, for messages.
    pub prim: String,
    /// What lies left and right of it.
    pub wrap_s: Wrap,
    /// What lies below and above it.
    pub wrap_t: Wrap,
    /// How its numbers are meant.
    pub color_space: ColorSpace,
}

/// A Ptex file to be read, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct PtexSource {
    /// Where it is.
    pub image: ImageSource,
    /// The prim that asks for it first, for messages.
    pub prim: String,
    /// How it is looked up.
    pub options: PtexOptions,
}

/// UsdRender's settings and first raster product; what is not authored is `None`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RenderSettings {
    /// The settings prim.
    pub path: Option<String>,
    /// Path of the camera.
    pub camera: Option<String>,
    /// Pixels.
    pub resolution: Option<[u32; 2]>,
    /// Width over height of a pixel.
    pub pixel_aspect_ratio: Option<f32>,
    /// How the camera's aperture is made to fit.
    pub conform: AspectRatioConform,
    /// xmin, ymin, xmax, ymax in 0..1, y up: the part that is rendered.
    pub data_window: Option<[f32; 4]>,
    /// Whether the file forbids motion blur.
    pub disable_motion_blur: Option<bool>,
    /// Whether the file forbids depth of field.
    pub disable_depth_of_field: Option<bool>,
    /// Purposes that the file wants to be shown beside `default`.
    pub included_purposes: Option<Vec<Purpose>>,
    /// The product's file name.
    pub product_name: Option<String>,
    /// `sourceName`s of the product's ordered variables.
    pub aovs: Vec<String>,
}

/// UsdRenderSettings `aspectRatioConformPolicy`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AspectRatioConform {
    /// Enlarge the aperture's short side.
    #[default]
    ExpandAperture,
    /// Cut its long side.
    CropAperture,
    /// Change its width.
    AdjustApertureWidth,
    /// Change its height.
    AdjustApertureHeight,
    /// Change the pixel's shape.
    AdjustPixelAspectRatio,
}
