use serde::Deserialize;

/// What the site wants of a job: the section `[cluster]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(transparent)]
pub struct Cluster {
    /// Its settings.
    pub settings: toml::Table,
}
