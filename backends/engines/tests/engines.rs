//! The table of the engines is consistent, and each opens or says why it does not.

use std::collections::HashSet;

use esvo_core::CastError;
use esvo_core::reference::ReferenceCaster;
use esvo_engines::{
    Allowed, EngineId, GpuOptions, InstructionSet, OpenFailure, OpenOptions, RegisterError, UnknownEngine,
};

#[test]
fn names_are_read_back() {
    let mut names = HashSet::new();
    for &id in EngineId::ALL {
        assert_eq!(id.engine().id, id);
        assert!(names.insert(id.name()), "{id} stands in the table twice");
        assert_eq!(id.to_string().parse(), Ok(id));
        assert_eq!(serde_json::to_string(&id).unwrap(), format!("\"{id}\""));
        assert_eq!(serde_json::from_str::<EngineId>(&format!("\"{id}\"")).unwrap(), id);
        assert_eq!(id.name(), id.name().to_lowercase());
    }
    assert!(EngineId::ALL.is_sorted());
    assert_eq!(&EngineId::ALL[..2], [EngineId::Reference, EngineId::Cpu]);
}

#[test]
fn unknown_names_are_refused_with_those_that_exist() {
    for name in ["cuda", "", "CPU", "cpu "] {
        let error = name.parse::<EngineId>().unwrap_err();
        assert_eq!(error, UnknownEngine { name: name.into() });
        let text = error.to_string();
        assert!(text.contains(&format!("{name:?}")) && text.contains("reference, cpu, wgpu, ash"), "{text}");
        for &id in EngineId::ALL {
            let built_in = text.split("was built with").nth(1).unwrap();
            assert_eq!(built_in.contains(id.name()), id.engine().is_built_in(), "{text}");
        }
    }
}

#[test]
fn each_engine_opens_or_says_what_is_missing() {
    for &id in EngineId::ALL {
        match id.open(&OpenOptions { threads: Some(1), ..OpenOptions::default() }) {
            Ok(caster) => assert_eq!(caster.name(), id.name()),
            Err(error) => {
                assert!(error.to_string().starts_with(&format!("engine {id}: ")), "{error}");
                match error.reason {
                    OpenFailure::NotBuiltIn { feature } => {
                        assert!(!id.engine().is_built_in());
                        assert!(error.to_string().ends_with(&format!("--features {feature}`")), "{error}");
                    }
                    OpenFailure::Foreign => panic!("{id} is in the table"),
                    OpenFailure::Cast(error) => {
                        assert!(id.engine().is_built_in() && id.engine().feature.is_some(), "{error}");
                        assert!(std::env::var_os("ESVO_REQUIRE_GPU").is_none(), "{error}");
                        println!("{id} skipped: {error}");
                    }
                }
            }
        }
    }
}

#[test]
fn engines_of_gpus_cast_triangles() {
    for &id in EngineId::ALL {
        match id.open_triangles(&OpenOptions::default()) {
            Ok(Some(caster)) => assert!(caster.name() == id.name() && id.engine().feature.is_some()),
            Ok(None) => assert!(id.engine().feature.is_none(), "{id}"),
            Err(error) => match error.reason {
                OpenFailure::NotBuiltIn { .. } => assert!(!id.engine().is_built_in(), "{id}"),
                OpenFailure::Foreign => panic!("{id} is in the table"),
                OpenFailure::Cast(error) => assert!(std::env::var_os("ESVO_REQUIRE_GPU").is_none(), "{error}"),
            },
        }
    }
}

#[test]
fn options_reach_the_engine() {
    let caster = EngineId::Cpu.open(&OpenOptions { threads: Some(3), ..OpenOptions::default() }).unwrap();
    assert!(caster.device().detail.contains("3 threads"), "{}", caster.device().detail);
    for set in InstructionSet::ALL {
        let options = OpenOptions { instructions: Some(set), ..OpenOptions::default() };
        match EngineId::Cpu.open(&options) {
            Ok(caster) => assert!(set.is_available() && caster.device().detail.contains(set.name())),
            Err(error) => assert!(!set.is_available() && error.to_string().contains(set.name()), "{error}"),
        }
    }
    let gpu = GpuOptions { adapter: Some("nobody's".into()), ..GpuOptions::default() };
    let options = OpenOptions { gpu, ..OpenOptions::default() };
    for id in [EngineId::Wgpu, EngineId::Ash].into_iter().filter(|id| id.engine().is_built_in()) {
        let Err(error) = id.open(&options) else { panic!("{id}: a device that does not exist was opened") };
        assert!(matches!(&error.reason, OpenFailure::Cast(CastError::Device(_))), "{error}");
        if std::env::var_os("ESVO_REQUIRE_GPU").is_some() {
            assert!(error.to_string().contains("nobody's"), "{error}");
        }
    }
}

#[test]
fn only_gpus_may_differ_from_the_reference() {
    for &id in EngineId::ALL {
        let allowed = id.allowed();
        let exact = (allowed.share, allowed.t) == (0.0, 0.0);
        assert_eq!(exact, matches!(id, EngineId::Reference | EngineId::Cpu), "{id}");
        assert!(allowed.share <= 1e-5 && allowed.t <= 1.0 / 8192.0, "{id}");
    }
}

#[test]
fn an_engine_of_ones_own_is_known_once_it_is_registered() {
    let register = |name| {
        EngineId::register(name, "The reference by another name", Allowed::EXACT, |_| Ok(ReferenceCaster::default()))
    };
    // As a record of another program has it.
    let recorded: EngineId = serde_json::from_str("\"mine-1\"").unwrap();
    assert!(!recorded.is_known() && !EngineId::all().contains(&recorded));
    assert!("mine-1".parse::<EngineId>().is_err());
    let Err(error) = recorded.open(&OpenOptions::default()) else { panic!("it cannot be opened") };
    assert!(matches!(error.reason, OpenFailure::Foreign), "{error}");
    assert_eq!(serde_json::from_str::<EngineId>("\"mine-1\"").unwrap(), recorded);

    let own = register("mine-1").unwrap();
    assert_eq!((own, "mine-1".parse()), (recorded, Ok(own)));
    assert!(own.is_known() && EngineId::all().contains(&own) && own.allowed() == Allowed::EXACT);
    assert_eq!(serde_json::to_string(&own).unwrap(), "\"mine-1\"");
    assert_eq!(own.open(&OpenOptions::default()).unwrap().name(), "reference");
    assert!(own.open_triangles(&OpenOptions::default()).unwrap().is_none());

    for name in ["mine-1", "cpu"] {
        assert_eq!(register(name), Err(RegisterError::Taken { name: name.into() }));
    }
    for name in ["", "Mine", "my caster", &"x".repeat(33)] {
        assert_eq!(register(name), Err(RegisterError::Name { name: name.into() }));
        let json = serde_json::to_string(name).unwrap();
        assert!(serde_json::from_str::<EngineId>(&json).unwrap_err().to_string().contains("lower-case"));
    }
    // No record fills the memory with names.
    let many = (0..100).map(|k| serde_json::from_str::<EngineId>(&format!("\"many-{k}\"")));
    assert!(many.filter(Result::is_err).count() >= 36);
}
