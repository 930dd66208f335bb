//! The user of the services, and checks with this user's permissions.

#[cfg(target_os = "linux")]
pub(super) use linux::ServiceUser;
#[cfg(not(target_os = "linux"))]
pub(super) use present::ServiceUser;

/// The user of the services of `deploy/systemd`.
#[cfg(target_os = "linux")]
const NAME: &str = "trimaran";

#[cfg(target_os = "linux")]
mod linux {
    use std::{ffi::CString, io, thread};

    use nix::unistd::{User, getgrouplist};
    use rustix::{
        process::{Gid, Uid, geteuid},
        thread::{set_thread_groups, set_thread_res_gid, set_thread_res_uid},
    };

    use crate::cli::Failure;

    /// Another user than the present one.
    #[derive(Debug)]
    pub(in super::super) struct ServiceUser {
        name: String,
        uid: Uid,
        gid: Gid,
        groups: Vec<Gid>,
    }

    impl ServiceUser {
        /// The user of this name; without one that of the services, if there is one and this process is
        /// root's. `None` for the present user.
        ///
        /// # Errors
        /// If there is no such user, or this process is not root's.
        pub(in super::super) fn find(named: Option<&str>) -> Result<Option<Self>, Failure> {
            match (named, geteuid().is_root()) {
                (None, false) => Ok(None),
                (None, true) => Self::of(super::NAME),
                (Some(_), false) => {
                    Err(Failure::bad_input("--user needs root; without it the checks are made as you"))
                }
                (Some(name), true) => match Self::of(name)? {
                    Some(user) => Ok(Some(user)),
                    None => Err(Failure::bad_input(format!("there is no user {name}"))),
                },
            }
        }

        fn of(name: &str) -> Result<Option<Self>, Failure> {
            let Some(user) = User::from_name(name).map_err(Failure::broken)? else { return Ok(None) };
            let groups = CString::new(name).map_err(Failure::bad_input)?;
            let groups = getgrouplist(&groups, user.gid).map_err(Failure::broken)?;
            Ok(Some(Self {
                name: name.to_owned(),
                uid: Uid::from_raw(user.uid.as_raw()),
                gid: Gid::from_raw(user.gid.as_raw()),
                groups: groups.into_iter().map(|group| Gid::from_raw(group.as_raw())).collect(),
            }))
        }

        pub(in super::super) fn name(&self) -> &str {
            &self.name
        }

        /// The result of `work`, done by a thread with this user's permissions. Threads that it starts have
        /// them as well, and the rest of the process does not.
        ///
        /// # Errors
        /// If the system gives no such thread.
        pub(in super::super) fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
            thread::scope(|scope| {
                let work = || self.take_on().map(|()| work()).map_err(Failure::broken);
                let thread = thread::Builder::new().spawn_scoped(scope, work).map_err(Failure::broken)?;
                thread.join().unwrap_or_else(|_| Err(Failure::broken("a check ended early: see above")))
            })
        }

        /// Changes the calling thread's user for ever.
        fn take_on(&self) -> io::Result<()> {
            set_thread_groups(&self.groups)?;
            set_thread_res_gid(self.gid, self.gid, self.gid)?;
            Ok(set_thread_res_uid(self.uid, self.uid, self.uid)?)
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod present {
    use crate::cli::Failure;

    /// Another user than the present one: there is none on this system.
    #[derive(Debug)]
    pub(in super::super) enum ServiceUser {}

    impl ServiceUser {
        pub(in super::super) fn find(named: Option<&str>) -> Result<Option<Self>, Failure> {
            match named {
                Some(_) => {
                    Err(Failure::bad_input("--user needs Linux; without it the checks are made as you"))
                }
                None => Ok(None),
            }
        }

        pub(in super::super) fn name(&self) -> &str {
            match *self {}
        }

        pub(in super::super) fn run<T: Send>(&self, _: impl FnOnce() -> T + Send) -> Result<T, Failure> {
            match *self {}
        }
    }
}
