//! Frames of another display that this one follows: nothing is culled or looked up for it.

use std::sync::Arc;

use futures_util::future::OptionFuture;
use trimaran_cull::View;
use trimaran_proto::{FrameNumber, LeaderKey, RoleMessage};

use super::{CullerWork, Session, inbox::Wish};
use crate::{
    driver::error::{RoleError, link},
    leads::{Following, LedFrame, LedView},
    supply::CullerEnd,
};

impl<W: CullerWork> Session<W> {
    /// Other displays may follow this one from now on. They get its last frame at once.
    pub(super) fn begin_to_lead(&mut self, leader: LeaderKey) -> Result<(), RoleError> {
        if self.lead.as_ref().is_some_and(|lead| lead.key() == leader) {
            return Ok(());
        }
        self.lead = self.sharing.leads.lead(leader, &self.settings, self.drawables);
        if self.lead.is_none() {
            tracing::warn!("another display leads by the key that this one has chosen: nobody follows it");
        }
        self.tell_followers()
    }

    /// Passes the last frame on to those who follow.
    pub(super) fn tell_followers(&self) -> Result<(), RoleError> {
        if let (Some(lead), Some(camera), Some(state), Some((_, ids))) =
            (&self.lead, self.camera, &self.state, &self.last)
        {
            lead.publish(camera, state, ids)?;
        }
        Ok(())
    }

    /// Sends the leader's frames until the display wants otherwise, or nobody leads any more.
    pub(super) async fn change_leader(&mut self, mut wish: Wish) -> Result<(), RoleError> {
        let leader = loop {
            let (leader, following) = match wish {
                Wish::Follow(leader) => (leader, self.sharing.leads.follow(leader)?),
                Wish::Unfollow(leader) => (leader, None),
            };
            let Some(following) = following else { break leader };
            // A follower does not lead: its own followers are told. Its next own frame is culled anew.
            (self.lead, self.state, self.camera, self.last) = (None, None, None, None);
            self.supply_follows(true);
            self.tell(RoleMessage::Followed { leader, first: self.sent }).await?;
            match self.follow(following).await? {
                Some(next) => wish = next,
                None => break leader,
            }
        };
        self.supply_follows(false);
        self.tell(RoleMessage::Unfollowed { leader, first: self.sent }).await
    }

    /// Sends the frames of one leader. A display that takes them slowly skips some. Returns the display's
    /// next wish; nothing if the leader is gone.
    async fn follow(&mut self, mut following: Following) -> Result<Option<Wish>, RoleError> {
        let mut view = None;
        loop {
            let frame = tokio::select! {
                biased;
                Some(fault) = OptionFuture::from(self.supply.as_ref().map(CullerEnd::failed)) => {
                    return Err(fault.into());
                }
                wish = self.inbox.wish(&mut self.display) => return wish.map(Some),
                changed = following.changed() => match changed {
                    Ok(()) => following.borrow_and_update().clone(),
                    Err(_) => return Ok(None),
                },
            };
            if let Some(frame) = frame {
                self.pass_on(&frame, &mut view).await?;
            }
        }
    }

    async fn pass_on(&mut self, led: &LedFrame, view: &mut Option<Arc<LedView>>) -> Result<(), RoleError> {
        let LedFrame { camera, ids, frame, .. } = led;
        if view.as_ref().is_none_or(|view| !Arc::ptr_eq(view, &led.view)) {
            for message in &led.view.messages {
                self.tell(message.clone()).await?;
            }
            if let Some(supply) = &self.supply {
                supply.change_view(&led.view.state);
            }
            *view = Some(Arc::clone(&led.view));
        }
        if let Some(supply) = &self.supply {
            supply.found(&View::of(*camera, &led.view.state), ids)?;
        }
        let number = self.sent;
        self.sent = FrameNumber(number.0.wrapping_add(1));
        self.display.frames_tx.send_shared(frame, number).await.map(drop).map_err(link("passing on a frame"))
    }

    async fn tell(&mut self, message: RoleMessage) -> Result<(), RoleError> {
        self.display.messages_tx.send(&message).await.map_err(link("telling the display about its leader"))
    }

    fn supply_follows(&self, follows: bool) {
        if let Some(supply) = &self.supply {
            supply.change_following(follows);
        }
    }
}
