//! Engines that are not in the table: those that a program registers, and those that a record names.

use std::sync::{PoisonError, RwLock};

use esvo_core::testing::compare::Allowed;
use esvo_core::{CastError, Caster};

use crate::options::OpenOptions;
use crate::table::{Engine, EngineId, Opener};

/// Place of an engine in the list of those that are not in the table.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, PartialOrd, Ord)]
pub struct OwnEngine(u8);

/// Engines are never removed, so that an [`EngineId`] is always that of an engine.
static OWN: RwLock<Vec<&'static Engine>> = RwLock::new(Vec::new());

/// Most engines that are not in the table, so that no record can fill the memory with names.
const MOST_ENGINES: usize = 64;
/// Most bytes of a name.
const MOST_BYTES: usize = 32;

/// An engine that cannot be registered.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum RegisterError {
    /// The name cannot be used.
    #[error("engine {name:?}: expected a name of 1 to {MOST_BYTES} lower-case letters, digits and hyphens")]
    Name {
        /// The name as given.
        name: String,
    },
    /// There is such an engine.
    #[error("engine {name:?}: there is one of this name; expected another name")]
    Taken {
        /// The name as given.
        name: String,
    },
    /// There are too many.
    #[error("engine {name:?}: {MOST_ENGINES} engines beside those of the table are known already; expected fewer")]
    TooMany {
        /// The name as given.
        name: String,
    },
}

impl EngineId {
    /// Makes an engine of one's own known by name, for as long as the program runs. From then on [`EngineId::from_str`] knows it, and
    /// whatever takes an `EngineId` takes it: a matrix of `esvo_bench`, its checks, tables, sweep and stability suite.
    ///
    /// `allowed` is what may differ between its hits and those of the reference caster; `open` opens it. Its caster's
    /// [`name`](Caster::name) should be the same.
    ///
    /// ```
    /// use esvo_core::reference::ReferenceCaster;
    /// use esvo_engines::{Allowed, EngineId, OpenOptions};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let own = EngineId::register("own", "The reference by another name", Allowed::EXACT, |_| Ok(ReferenceCaster::default()))?;
    /// assert_eq!("own".parse(), Ok(own));
    /// let caster = own.open(&OpenOptions::default())?;
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// A name that is taken, or that is not 1 to 32 lower-case letters, digits and hyphens; more than 64 engines.
    ///
    /// [`EngineId::from_str`]: std::str::FromStr::from_str
    pub fn register<C: Caster + 'static>(
        name: &str,
        description: &str,
        allowed: Allowed,
        open: impl Fn(&OpenOptions) -> Result<C, CastError> + Send + Sync + 'static,
    ) -> Result<Self, RegisterError> {
        let open = move |options: &OpenOptions| -> Result<Box<dyn Caster>, CastError> { Ok(Box::new(open(options)?)) };
        insert(name, description, allowed, Some(Box::leak(Box::new(open))))
    }

    /// The engine of this name in a record, which may be one of another program's own: then one that cannot be opened.
    ///
    /// # Errors
    /// As [`register`](Self::register), but for a name that is taken.
    pub(crate) fn recorded(name: &str) -> Result<Self, RegisterError> {
        match Self::ALL.iter().copied().chain(own().map(|engine| engine.id)).find(|id| id.name() == name) {
            Some(known) => Ok(known),
            None => insert(name, "An engine of another program", Allowed::GPU, None),
        }
    }

    /// Every engine that can be named: those of the table and those that were [registered](Self::register), in this order.
    pub fn all() -> Vec<Self> {
        let registered = own().filter(|engine| engine.is_built_in()).map(|engine| engine.id);
        Self::ALL.iter().copied().chain(registered).collect()
    }

    /// Whether it can be named: false for one that only a record names.
    pub fn is_known(self) -> bool {
        !matches!(self, Self::Own(_)) || self.engine().is_built_in()
    }
}

/// Those that are not in the table.
fn own() -> impl Iterator<Item = &'static Engine> {
    OWN.read().unwrap_or_else(PoisonError::into_inner).clone().into_iter()
}

impl OwnEngine {
    /// What is known of it.
    pub(crate) fn engine(self) -> &'static Engine {
        OWN.read().unwrap_or_else(PoisonError::into_inner)[usize::from(self.0)]
    }
}

/// Adds an engine. One that only a record named until now keeps its id.
fn insert(name: &str, description: &str, allowed: Allowed, opener: Option<Opener>) -> Result<EngineId, RegisterError> {
    let letter = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if name.is_empty() || name.len() > MOST_BYTES || !name.bytes().all(letter) {
        return Err(RegisterError::Name { name: name.into() });
    }
    let mut engines = OWN.write().unwrap_or_else(PoisonError::into_inner);
    let place = engines.iter().position(|engine| engine.name == name);
    let taken = EngineId::ALL.iter().any(|id| id.name() == name) || place.is_some_and(|k| engines[k].is_built_in());
    if taken {
        return Err(RegisterError::Taken { name: name.into() });
    }
    let place = place.unwrap_or(engines.len());
    if place >= MOST_ENGINES {
        return Err(RegisterError::TooMany { name: name.into() });
    }
    let id = EngineId::Own(OwnEngine(place as u8));
    let (name, description) = (String::leak(name.into()), String::leak(description.into()));
    let engine: &_ = Box::leak(Box::new(Engine { id, name, description, allowed, feature: None, opener }));
    match engines.get_mut(place) {
        Some(known) => *known = engine,
        None => engines.push(engine),
    }
    Ok(id)
}
