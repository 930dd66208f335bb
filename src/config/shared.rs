//! Keys that several roles have. In a file they stand beside the role's own keys; in a structure they are
//! nested.

use std::{net::SocketAddr, path::PathBuf, slice};

use bytesize::ByteSize;
use confique::{
    Config,
    meta::{Field, FieldKind, Meta},
};
use serde::Serialize;
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{enough_memory, memory, positive, seconds};

/// The device of a role that draws.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct GpuConfig {
    /// The Vulkan device, as `trimaran doctor` prints it: a part of its name, its UUID, its PCI address or its
    /// number, such as `#1`. If not given, the one that `CUDA_VISIBLE_DEVICES` names, or else the best one.
    #[config(env = "TRIMARAN_DEVICE", layer_attr(arg(long, value_name = "DEVICE")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// The most memory of the device for the scene's triangles, such as `64MiB`; the least used make room for
    /// those that show. Three quarters of what is free if not given.
    #[config(
        env = "TRIMARAN_GPU_MEMORY",
        validate = enough_memory,
        layer_attr(arg(long = "gpu-memory", value_name = "SIZE", value_parser = memory))
    )]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gpu_memory: Option<ByteSize>,
    /// How long the device may make no progress before it counts as hung, seconds. The role then ends with
    /// exit code 1, a display with exit code 3 and its report.
    #[config(
        env = "TRIMARAN_DEVICE_TIMEOUT_S",
        default = 30.0,
        validate(device_timeout_s.is_finite() && *device_timeout_s > 0.0, "give seconds above 0"),
        layer_attr(arg(long = "device-timeout", value_name = "S", value_parser = positive))
    )]
    pub device_timeout_s: f64,
    /// Cull on the device whatever its kind, and compare each frame with culling on the host. Slower; the
    /// session ends with an error at the first difference.
    #[config(
        env = "TRIMARAN_CHECK_DEVICE",
        default = false,
        layer_attr(arg(long, num_args = 0..=1, default_missing_value = "true", value_name = "BOOL"))
    )]
    pub check_device: bool,
}

/// The keys of every role.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct CommonConfig {
    /// How long to wait at the start for what is not there yet, such as a culler or a scene that is being
    /// copied, seconds. A walk in lockstep then begins with the cullers that are there.
    #[config(
        env = "TRIMARAN_JOIN_TIMEOUT_S",
        default = 30.0,
        validate = seconds,
        layer_attr(arg(long = "join-timeout", value_name = "S"))
    )]
    pub join_timeout_s: f64,
    /// Show figures on this address while the role runs: `/metrics` for Prometheus, `/livez` and `/readyz` for
    /// probes, `/status` and `/links` as JSON.
    #[config(env = "TRIMARAN_METRICS", layer_attr(arg(long, value_name = "HOST:PORT")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<SocketAddr>,
    /// The filter of the log: a level (`warn`, `info`, `debug`), or a filter such as `trimaran=debug`. By
    /// default `warn`, and `info` in systemd's journal.
    #[config(env = "TRIMARAN_LOG", layer_attr(arg(long, value_name = "FILTER")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
    /// This machine's private keys, `NAME.key` of `trimaran keys new NAME`: for transports that encrypt.
    #[config(env = "TRIMARAN_KEYS", layer_attr(arg(long, value_name = "NAME.key")))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keys: Option<PathBuf>,
}

/// The shared keys in a field, if it is `gpu` or `common`.
fn shared(field: &'static Field) -> Option<&'static [Field]> {
    match field.kind {
        FieldKind::Nested { meta } if ["gpu", "common"].contains(&field.name) => Some(meta.fields),
        _ => None,
    }
}

/// The keys and tables at the top of a role's file.
pub(super) fn top(role: &Meta) -> impl Iterator<Item = &'static Field> {
    role.fields.iter().flat_map(|field| shared(field).unwrap_or(slice::from_ref(field)))
}

/// Puts the shared keys of a file where the role's structure has them.
pub(super) fn nested<'t>(mut top: DeTable<'t>, role: &Meta) -> DeTable<'t> {
    for (field, keys) in role.fields.iter().filter_map(|field| Some((field.name, shared(field)?))) {
        let within = |key: &str| keys.iter().any(|field| field.name == key);
        let (shared, own): (DeTable<'_>, _) = top.into_iter().partition(|(key, _)| within(key.get_ref()));
        top = own;
        top.insert(Spanned::new(0..0, field.into()), Spanned::new(0..0, DeValue::Table(shared)));
    }
    top
}
