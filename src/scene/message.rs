//! Messages of `foxglove.SceneUpdate`: the fields that a scene uses, with the numbers of the
//! schema. Source: foxglove-sdk, `schemas/proto/foxglove` (MIT), whose descriptor is
//! `datasets_schema/foxglove.SceneUpdate.fds`.

use prost::Message;

/// Full name of the schema.
pub const SCHEMA: &str = "foxglove.SceneUpdate";
/// Serialised `FileDescriptorSet` of the schema with everything that it uses.
pub const DESCRIPTOR: &[u8] = include_bytes!("../../datasets_schema/foxglove.SceneUpdate.fds");

/// Update of a scene: entities that replace those of the same id.
#[derive(Clone, PartialEq, Message)]
pub struct SceneUpdate {
    /// New and replaced entities.
    #[prost(message, repeated, tag = "2")]
    pub entities: Vec<SceneEntity>,
}

/// Group of shapes with one name.
#[derive(Clone, PartialEq, Message)]
pub struct SceneEntity {
    /// Time of the entity.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<prost_types::Timestamp>,
    /// Frame of reference.
    #[prost(string, tag = "2")]
    pub frame_id: String,
    /// Name of the entity.
    #[prost(string, tag = "3")]
    pub id: String,
    /// Time until it disappears; zero for never.
    #[prost(message, optional, tag = "4")]
    pub lifetime: Option<prost_types::Duration>,
    /// Boxes.
    #[prost(message, repeated, tag = "8")]
    pub cubes: Vec<CubePrimitive>,
    /// Spheres.
    #[prost(message, repeated, tag = "9")]
    pub spheres: Vec<SpherePrimitive>,
    /// Cylinders.
    #[prost(message, repeated, tag = "10")]
    pub cylinders: Vec<CylinderPrimitive>,
    /// Lines.
    #[prost(message, repeated, tag = "11")]
    pub lines: Vec<LinePrimitive>,
}

/// Box.
#[derive(Clone, PartialEq, Message)]
pub struct CubePrimitive {
    /// Centre.
    #[prost(message, optional, tag = "1")]
    pub pose: Option<Pose>,
    /// Lengths of the edges (m).
    #[prost(message, optional, tag = "2")]
    pub size: Option<Vector3>,
    /// Colour.
    #[prost(message, optional, tag = "3")]
    pub color: Option<Color>,
}

/// Sphere.
#[derive(Clone, PartialEq, Message)]
pub struct SpherePrimitive {
    /// Centre.
    #[prost(message, optional, tag = "1")]
    pub pose: Option<Pose>,
    /// Diameters (m).
    #[prost(message, optional, tag = "2")]
    pub size: Option<Vector3>,
    /// Colour.
    #[prost(message, optional, tag = "3")]
    pub color: Option<Color>,
}

/// Cylinder along z.
#[derive(Clone, PartialEq, Message)]
pub struct CylinderPrimitive {
    /// Centre.
    #[prost(message, optional, tag = "1")]
    pub pose: Option<Pose>,
    /// Diameters and height (m).
    #[prost(message, optional, tag = "2")]
    pub size: Option<Vector3>,
    /// Scale of the bottom, 0 to 1.
    #[prost(double, tag = "3")]
    pub bottom_scale: f64,
    /// Scale of the top, 0 to 1.
    #[prost(double, tag = "4")]
    pub top_scale: f64,
    /// Colour.
    #[prost(message, optional, tag = "5")]
    pub color: Option<Color>,
}

/// Line through points.
#[derive(Clone, PartialEq, Message)]
pub struct LinePrimitive {
    /// Connection of the points.
    #[prost(enumeration = "LineType", tag = "1")]
    pub r#type: i32,
    /// Origin of the points.
    #[prost(message, optional, tag = "2")]
    pub pose: Option<Pose>,
    /// Thickness (m, or pixels if `scale_invariant`).
    #[prost(double, tag = "3")]
    pub thickness: f64,
    /// The thickness is in pixels.
    #[prost(bool, tag = "4")]
    pub scale_invariant: bool,
    /// Points (m).
    #[prost(message, repeated, tag = "5")]
    pub points: Vec<Point3>,
    /// Colour.
    #[prost(message, optional, tag = "6")]
    pub color: Option<Color>,
}

/// Connection of the points of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, prost::Enumeration)]
#[repr(i32)]
pub enum LineType {
    /// From each point to the next.
    Strip = 0,
    /// Closed polygon.
    Loop = 1,
    /// Separate segments of two points.
    List = 2,
}

/// Position and orientation.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Pose {
    /// Position (m).
    #[prost(message, optional, tag = "1")]
    pub position: Option<Vector3>,
    /// Orientation.
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

/// Vector.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Vector3 {
    /// Across the board.
    #[prost(double, tag = "1")]
    pub x: f64,
    /// From goal to goal.
    #[prost(double, tag = "2")]
    pub y: f64,
    /// Up.
    #[prost(double, tag = "3")]
    pub z: f64,
}

/// Point (m).
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Point3 {
    /// Across the board (m).
    #[prost(double, tag = "1")]
    pub x: f64,
    /// From goal to goal (m).
    #[prost(double, tag = "2")]
    pub y: f64,
    /// Up (m).
    #[prost(double, tag = "3")]
    pub z: f64,
}

/// Rotation as a unit quaternion.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Quaternion {
    /// First imaginary part.
    #[prost(double, tag = "1")]
    pub x: f64,
    /// Second imaginary part.
    #[prost(double, tag = "2")]
    pub y: f64,
    /// Third imaginary part.
    #[prost(double, tag = "3")]
    pub z: f64,
    /// Real part.
    #[prost(double, tag = "4")]
    pub w: f64,
}

/// Colour, each part from 0 to 1.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct Color {
    /// Red.
    #[prost(double, tag = "1")]
    pub r: f64,
    /// Green.
    #[prost(double, tag = "2")]
    pub g: f64,
    /// Blue.
    #[prost(double, tag = "3")]
    pub b: f64,
    /// Opacity.
    #[prost(double, tag = "4")]
    pub a: f64,
}
