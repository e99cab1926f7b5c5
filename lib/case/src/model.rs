use std::collections::BTreeMap;

use crate::engine::Engine;

/// The simulator, by engine: a command, or the name of a Yade script.
///
/// This is code of whoever wrote the case: it runs with the rights of whoever runs the case.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// What the section `[model]` has.
    pub by_engine: BTreeMap<Engine, String>,
    /// Given for this call by `model=COMMAND`, whatever the engine.
    pub given: Option<String>,
}

impl Model {
    /// What an engine runs: its own entry; else slurm and pbs take that of local, then of yade-batch, local
    /// takes that of yade-batch, and yade-batch that of local if it is a Yade script.
    pub fn of(&self, engine: Engine) -> Option<&str> {
        let entry = |engine| self.by_engine.get(&engine).map(String::as_str);
        let own = self.given.as_deref().or(entry(engine));
        own.or_else(|| match engine {
            Engine::Embedded => None,
            Engine::Local => entry(Engine::YadeBatch),
            Engine::YadeBatch => entry(Engine::Local).filter(|model| is_yade_script(model)),
            Engine::Slurm | Engine::Pbs => entry(Engine::Local).or(entry(Engine::YadeBatch)),
        })
    }

    /// The engine that the case is run by when none is asked for: the first of embedded, local and yade-batch
    /// that it has a model for.
    pub fn default_engine(&self) -> Option<Engine> {
        Engine::ALL.into_iter().find(|engine| self.by_engine.contains_key(engine) && !engine.is_queue())
    }
}

/// Whether a model is a Yade script: one word that ends in `.py`.
fn is_yade_script(model: &str) -> bool {
    model.ends_with(".py") && !model.contains(char::is_whitespace)
}
