//! The names of the engines: written, read, and refused.

use std::borrow::Cow;
use std::fmt::{Display, Formatter};
use std::str::FromStr;

use esvo_core::testing::compare::Allowed;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::table::{Engine, EngineId};

impl EngineId {
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
    let engines = EngineId::all().into_iter().map(EngineId::engine);
    let names: Vec<_> = engines.filter(|engine| which(engine)).map(|engine| engine.name).collect();
    names.join(", ")
}

impl FromStr for EngineId {
    type Err = UnknownEngine;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let engine = Self::all().into_iter().find(|id| id.name() == name);
        engine.ok_or_else(|| UnknownEngine { name: name.into() })
    }
}

/// As its name.
impl Serialize for EngineId {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// From its name. One that is not known becomes an engine that cannot be opened, since a record may be of a program that
/// [registered](EngineId::register) it; what is to be run checks [`EngineId::is_known`].
impl<'de> Deserialize<'de> for EngineId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::recorded(&Cow::<str>::deserialize(deserializer)?).map_err(serde::de::Error::custom)
    }
}
