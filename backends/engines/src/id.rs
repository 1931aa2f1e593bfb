//! The names of the engines: written, read, and refused.

use std::borrow::Cow;
use std::fmt::{Display, Formatter};
use std::str::FromStr;

use esvo_core::testing::compare::Allowed;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::table::{Engine, EngineId, TABLE};

impl EngineId {
    /// What is known of it.
    pub fn engine(self) -> &'static Engine {
        &TABLE[self as usize]
    }

    /// Its name, as in a matrix and on the command line.
    pub fn name(self) -> &'static str {
        self.engine().name
    }

    /// What may differ between its hits and those of the reference caster.
    pub fn allowed(self) -> Allowed {
        self.engine().allowed
    }
}

impl Display for EngineId {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// No engine has this name. The text lists those that exist and those that this program was built with.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "no engine is called {name:?}; the engines are {}, and this program was built with {}",
    list(|_| true),
    list(Engine::is_built_in)
)]
pub struct UnknownEngine {
    /// The name as given.
    pub name: String,
}

/// Names of the engines of which `which` is true.
fn list(which: impl Fn(&Engine) -> bool) -> String {
    let names: Vec<_> = TABLE.iter().filter(|engine| which(engine)).map(|engine| engine.name).collect();
    names.join(", ")
}

impl FromStr for EngineId {
    type Err = UnknownEngine;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let engine = TABLE.iter().find(|engine| engine.name == name);
        engine.map(|engine| engine.id).ok_or_else(|| UnknownEngine { name: name.into() })
    }
}

/// As its name.
impl Serialize for EngineId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// From its name.
impl<'de> Deserialize<'de> for EngineId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Cow::<str>::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
