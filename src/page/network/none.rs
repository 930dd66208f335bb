//! No simulated network: the program was built without the feature `lab`.

use std::{convert::Infallible, sync::Arc};

use tokio::io::DuplexStream;
use trimaran_net::Net;

use super::{Connection, NetworkError, SimulatedNetwork, Wanted};

#[derive(Debug, Default)]
pub(in crate::page) struct Networks {}

#[derive(Debug)]
pub(in crate::page) struct Network(Infallible);

pub(in crate::page) const fn names() -> Vec<SimulatedNetwork> {
    Vec::new()
}

impl Networks {
    pub(in crate::page) fn get(&self, _: Wanted, _: &Arc<dyn Net>) -> Result<Arc<Network>, NetworkError> {
        Err(NetworkError::Unknown)
    }
}

impl Network {
    pub(in crate::page) fn cross(self: Arc<Self>, _: impl Connection + 'static) -> DuplexStream {
        match self.0 {}
    }
}
