//! A hang-up (SIGHUP) asks a role to read its configuration again. The level of its log, its limits and the
//! keys of its peers change at once; links stay. All else holds from its next start.

use std::io::{self, IsTerminal};

use clap::Args;
use tokio::{runtime::Runtime, task::JoinSet};
use trimaran::{
    config::{RoleConfig, RoleNeeds},
    metrics::Metrics,
};
use trimaran_actors::SessionLimits;
use trimaran_transport::{ListenerLimits, keys::KnownPeers};

use super::{
    Failure,
    args::RoleArgs,
    log::{Filter, SAID},
    reload::HangUps,
};

/// The parts of a running role that its configuration may change.
pub(super) struct Live {
    pub(super) metrics: Metrics,
    pub(super) peers: Option<KnownPeers>,
    /// Of the listener, if it listens.
    pub(super) limits: Option<ListenerLimits>,
    /// Of its sessions, if it is a culler.
    pub(super) sessions: Option<SessionLimits>,
}

/// Reads a role's configuration again, once the role runs. Until then a hang-up waits.
pub(super) struct Reconfigure<L: Args> {
    args: RoleArgs<L>,
    /// None in a terminal, whose hang-up ends the role.
    hang_ups: Option<HangUps>,
}

impl<L: Args + Clone + Send + Sync + 'static> Reconfigure<L> {
    /// # Errors
    /// When signals cannot be received.
    pub(super) fn listen(args: &RoleArgs<L>, runtime: &Runtime) -> Result<Self, Failure> {
        let listens = !io::stderr().is_terminal();
        let hang_ups = listens.then(|| HangUps::listen(runtime)).transpose()?;
        Ok(Self { args: args.clone(), hang_ups })
    }

    /// Changes what is `live` at each hang-up, until the result is dropped. `limits` are the sessions' limits
    /// by a configuration.
    pub(super) fn begin<C>(
        self,
        live: Live,
        limits: impl Fn(&C) -> Result<SessionLimits, Failure> + Send + 'static,
        runtime: &Runtime,
    ) -> JoinSet<()>
    where
        C: RoleConfig<Layer = L> + RoleNeeds + 'static,
    {
        let mut tasks = JoinSet::new();
        let Self { args, hang_ups: Some(mut hang_ups) } = self else { return tasks };
        let reading = async move {
            loop {
                hang_ups.next().await;
                match live.change(&args, &limits) {
                    Ok(()) => tracing::info!(target: SAID, "has read its configuration again"),
                    Err(failure) => tracing::warn!(target: SAID, "goes on with its configuration: {failure}"),
                }
            }
        };
        tasks.spawn_on(reading, runtime.handle());
        tasks
    }
}

impl Live {
    /// Nothing changes unless all of the configuration can be used.
    fn change<C>(
        &self,
        args: &RoleArgs<C::Layer>,
        limits: impl Fn(&C) -> Result<SessionLimits, Failure>,
    ) -> Result<(), Failure>
    where
        C: RoleConfig + RoleNeeds,
        C::Layer: Args + Clone,
    {
        let (config, options): (C, _) = args.load()?;
        let filter = Filter::new(config.common().log.as_deref())?;
        let security = config.security(&options).map_err(Failure::bad_input)?;
        let new_limits = self.sessions.as_ref().map(|_| limits(&config)).transpose()?;
        filter.set();
        if let (Some(known), Some(security)) = (&self.peers, security) {
            known.replace(&security.peers);
        }
        if let Some(listener) = &self.limits {
            listener.change(options.limits);
        }
        if let (Some(sessions), Some(limits)) = (&self.sessions, new_limits) {
            sessions.change(&limits);
            self.metrics.has_places(options.limits.peers);
        }
        Ok(())
    }
}

impl<L: Args + Clone> RoleArgs<L> {
    /// The configuration that the flags, the environment and the file give.
    pub(super) fn load<C: RoleConfig<Layer = L>>(&self) -> Result<(C, trimaran_transport::Options), Failure> {
        C::load(self.flags.clone(), &self.links.options, self.config.as_deref()).map_err(Failure::bad_input)
    }
}
