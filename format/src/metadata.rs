//! The metadata of a file (spec 2.3): what its space means, names and bounds of its objects, where it comes from.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Registered members whose values are strings.
pub(crate) const STRINGS: [&str; 6] = ["title", "author", "license", "source", "generator", "created"];
/// Registered members whose values are whole numbers.
pub(crate) const COUNTS: [&str; 3] = ["triangles", "cells", "model_voxels"];
/// Registered members whose values are objects whose members are not checked.
pub(crate) const FREE: [&str; 3] = ["settings", "displacement", "attachments"];

/// The axis of mesh space that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpAxis {
    /// x
    #[serde(rename = "+x")]
    X,
    /// -x
    #[serde(rename = "-x")]
    MinusX,
    /// y
    #[serde(rename = "+y")]
    Y,
    /// -y
    #[serde(rename = "-y")]
    MinusY,
    /// z
    #[serde(rename = "+z")]
    Z,
    /// -z
    #[serde(rename = "-z")]
    MinusZ,
}

impl UpAxis {
    pub(crate) fn of(value: &Value) -> Option<Self> {
        Self::deserialize(value).ok()
    }

    /// The direction that is up.
    pub fn direction(self) -> [f64; 3] {
        match self {
            Self::X => [1.0, 0.0, 0.0],
            Self::MinusX => [-1.0, 0.0, 0.0],
            Self::Y => [0.0, 1.0, 0.0],
            Self::MinusY => [0.0, -1.0, 0.0],
            Self::Z => [0.0, 0.0, 1.0],
            Self::MinusZ => [0.0, 0.0, -1.0],
        }
    }
}

/// Whether the axes x, y and z of mesh space are like thumb, index finger and middle finger of the right or of the left hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Handedness {
    /// Right
    Right,
    /// Left
    Left,
}

impl Handedness {
    pub(crate) fn of(value: &Value) -> Option<Self> {
        Self::deserialize(value).ok()
    }
}

/// A box in mesh space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// The corner with the lowest coordinates.
    pub low: [f64; 3],
    /// The corner with the highest coordinates.
    pub high: [f64; 3],
}

/// The bounds that a value stands for. `None` if it has no two corners, or they are not in order.
pub(crate) fn bounds_of(value: &Value) -> Option<Bounds> {
    // An array would do for serde, too.
    let bounds = Bounds::deserialize(Value::Object(value.as_object()?.clone())).ok()?;
    bounds.low.iter().zip(bounds.high).all(|(low, high)| *low <= high).then_some(bounds)
}

/// What is known about one object, or one instance (without bounds).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectMetadata {
    /// Its name.
    pub name: Option<String>,
    /// A box that the surface lies in, in mesh space.
    pub bounds: Option<Bounds>,
    /// What else is known about it; registered names mean the same as those of [`Metadata`].
    pub metadata: Map<String, Value>,
    /// Members that are not registered, and registered ones whose values are not as they should be.
    pub other: Map<String, Value>,
}

/// The metadata of a file. Everything is optional, and nothing of it changes what the octrees are.
///
/// ```
/// use esvo_format::{Metadata, UpAxis};
///
/// let text = r#"{"title":"A tree","unit":0.01,"up":"+z","own":[1,2],"author":7}"#;
/// let mut metadata = Metadata::parse(text)?;
/// assert_eq!((metadata.unit, metadata.up), (Some(0.01), Some(UpAxis::Z)));
/// // Not as it should be: no author, but nothing is lost.
/// assert_eq!((metadata.author.as_ref(), &metadata.other["author"]), (None, &7.into()));
/// metadata.title = Some("A large tree".into());
/// assert_eq!(metadata.to_string(), r#"{"author":7,"own":[1,2],"title":"A large tree","unit":0.01,"up":"+z"}"#);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metadata {
    /// Title of the scene.
    pub title: Option<String>,
    /// Who made the scene.
    pub author: Option<String>,
    /// Licence of the scene, an SPDX expression.
    pub license: Option<String>,
    /// Where the mesh is from.
    pub source: Option<String>,
    /// Program that wrote the file, and its version.
    pub generator: Option<String>,
    /// Date and time of writing, as in RFC 3339.
    pub created: Option<String>,
    /// Metres per unit of mesh space and scene space, above 0.
    pub unit: Option<f64>,
    /// The axis of both that points up.
    pub up: Option<UpAxis>,
    /// Handedness of both.
    pub handedness: Option<Handedness>,
    /// Triangles of the mesh that the octree was made from.
    pub triangles: Option<u64>,
    /// Cubes that the octree was made from, where it was made from a list of cubes.
    pub cells: Option<u64>,
    /// Voxels of the voxel model that the octree was made from.
    pub model_voxels: Option<u64>,
    /// Settings of the generator, by its own names.
    pub settings: Option<Map<String, Value>>,
    /// How the generator displaced the mesh, by its own names.
    pub displacement: Option<Map<String, Value>>,
    /// What attachments of types 16 to 31 are, by number: objects with `name`, and perhaps `unit` and `about` (spec 8.7).
    pub attachments: Option<Map<String, Value>>,
    /// What is known about the objects, by index; may have fewer entries than the file has objects.
    pub objects: Vec<ObjectMetadata>,
    /// What is known about the instances, by index.
    pub instances: Vec<ObjectMetadata>,
    /// Members that are not registered, and registered ones whose values are not as they should be.
    pub other: Map<String, Value>,
}

impl Metadata {
    /// Reads metadata, e.g. that of [`Octree::meta`](crate::Octree::meta). An empty text has none.
    ///
    /// # Errors
    /// The text is no JSON object.
    pub fn parse(text: &str) -> serde_json::Result<Self> {
        if text.is_empty() {
            return Ok(Self::default());
        }
        let mut other: Map<String, Value> = serde_json::from_str(text)?;
        let from = &mut other;
        Ok(Self {
            title: take(from, "title", string),
            author: take(from, "author", string),
            license: take(from, "license", string),
            source: take(from, "source", string),
            generator: take(from, "generator", string),
            created: take(from, "created", string),
            unit: take(from, "unit", |value| value.as_f64().filter(|unit| *unit > 0.0)),
            up: take(from, "up", UpAxis::of),
            handedness: take(from, "handedness", Handedness::of),
            triangles: take(from, "triangles", whole),
            cells: take(from, "cells", whole),
            model_voxels: take(from, "model_voxels", whole),
            settings: take(from, "settings", map),
            displacement: take(from, "displacement", map),
            attachments: take(from, "attachments", map),
            objects: take(from, "objects", |list| ObjectMetadata::list(list, true)).unwrap_or_default(),
            instances: take(from, "instances", |list| ObjectMetadata::list(list, false)).unwrap_or_default(),
            other,
        })
    }

    /// Whether there is nothing to say.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Name of an object, if it has one.
    pub fn object_name(&self, index: usize) -> Option<&str> {
        self.objects.get(index)?.name.as_deref()
    }

    /// All members.
    pub fn members(&self) -> Map<String, Value> {
        let mut members = self.other.clone();
        let mut put = |name: &str, value: Option<Value>| {
            if let Some(value) = value {
                members.insert(name.into(), value);
            }
        };
        let strings = [&self.title, &self.author, &self.license, &self.source, &self.generator, &self.created];
        for (name, value) in STRINGS.into_iter().zip(strings) {
            put(name, value.clone().map(Value::from));
        }
        put("unit", self.unit.map(Value::from));
        put("up", self.up.and_then(|up| serde_json::to_value(up).ok()));
        put("handedness", self.handedness.and_then(|hand| serde_json::to_value(hand).ok()));
        for (name, value) in COUNTS.into_iter().zip([self.triangles, self.cells, self.model_voxels]) {
            put(name, value.map(Value::from));
        }
        for (name, value) in FREE.into_iter().zip([&self.settings, &self.displacement, &self.attachments]) {
            put(name, value.clone().map(Value::from));
        }
        for (name, list) in [("objects", &self.objects), ("instances", &self.instances)] {
            // An empty list says no more than none.
            let entries = || list.iter().map(ObjectMetadata::members).map(Value::from).collect();
            put(name, (!list.is_empty()).then(entries));
        }
        members
    }
}

/// The JSON text, members in the order of their names.
impl std::fmt::Display for Metadata {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", Value::from(self.members()))
    }
}

impl ObjectMetadata {
    /// The entries of a list, `None` if it is no list of objects.
    fn list(value: &Value, bounds: bool) -> Option<Vec<Self>> {
        let entry = |entry: &Value| {
            let mut other = map(entry)?;
            let from = &mut other;
            Some(Self {
                name: take(from, "name", string),
                bounds: if bounds { take(from, "bounds", bounds_of) } else { None },
                metadata: take(from, "metadata", map).unwrap_or_default(),
                other,
            })
        };
        value.as_array()?.iter().map(entry).collect()
    }

    fn members(&self) -> Map<String, Value> {
        let mut members = self.other.clone();
        members.extend(self.name.clone().map(|name| ("name".into(), name.into())));
        members.extend(self.bounds.and_then(|bounds| Some(("bounds".into(), serde_json::to_value(bounds).ok()?))));
        if !self.metadata.is_empty() {
            members.insert("metadata".into(), self.metadata.clone().into());
        }
        members
    }
}

/// Takes a member out if it is what it should be.
fn take<T>(members: &mut Map<String, Value>, name: &str, read: impl Fn(&Value) -> Option<T>) -> Option<T> {
    let found = read(members.get(name)?)?;
    members.remove(name);
    Some(found)
}

/// A whole number that binary64 tells from its neighbours: at most 2^53 - 1.
pub(crate) fn whole(value: &Value) -> Option<u64> {
    let number = value.as_f64()?;
    (number.fract() == 0.0 && (0.0..9_007_199_254_740_992.0).contains(&number)).then_some(number as u64)
}

fn string(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

fn map(value: &Value) -> Option<Map<String, Value>> {
    value.as_object().cloned()
}
