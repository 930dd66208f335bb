//! Geometry is packed once for all sessions of a service.

use std::{collections::BTreeSet, thread};

use trimaran_actors::{Link, NewSession, Sharing, Stop, Stopper};
use trimaran_proto::{Demand, DrawableId, Supply, items, put_item};

use crate::common::Device;
use crate::sessions::{SIDE, Service, asks, camera};

const SESSIONS: usize = 8;

/// Takes all geometry of a frame, and returns the packed bytes of its pieces and records, in their order.
async fn take_geometry(link: &mut Link, pieces: usize) -> Vec<Vec<u8>> {
    let bulk = link.bulk.as_mut().unwrap();
    let mut block = Vec::new();
    assert!(put_item(&mut block, &Demand::Begin { coarser_first: false, ahead: 0 }));
    bulk.tx.send(block.into()).await.unwrap();
    let (mut complete, mut taken, mut came) = (0, 0, Vec::new());
    while complete < pieces {
        let block = bulk.rx.recv().await.unwrap();
        taken += block.len() as u64;
        for item in items(&block).unwrap() {
            match item {
                Supply::Geometry { length, offset, part, .. } => {
                    complete += usize::from(offset as usize + part.len() == length as usize);
                    came.push(part.to_vec());
                }
                Supply::Entries { packed } => came.push(packed.to_vec()),
                _ => {}
            }
        }
        let mut block = Vec::new();
        assert!(put_item(&mut block, &Demand::Taken { bytes: taken }));
        bulk.tx.send(block.into()).await.unwrap();
    }
    came
}

#[test]
fn geometry_is_packed_once_for_all_sessions() {
    let service = Service::of(100);
    let sharing = Sharing::default();
    let (stopper, stop) = Stop::new();
    thread::scope(|scope| {
        let mut links = Vec::new();
        for _ in 0..SESSIONS {
            let (session, far) = service.session(SIDE);
            let session = NewSession { sharing: sharing.clone(), ..session };
            links.push(far);
            let (service, stop) = (&service, stop.clone());
            scope.spawn(move || service.supply(session, Device::default(), Some(&service.scene), &stop));
        }
        service.completes(async {
            let mut first = None;
            for link in &mut links {
                let ids = asks(link, camera(1, 0)).await;
                let geometry = |id: &DrawableId| service.scene.drawables().get(id.index()).unwrap().geometry;
                let pieces: BTreeSet<u32> = ids.iter().map(geometry).collect();
                let came = take_geometry(link, pieces.len()).await;
                assert_eq!(&came, first.get_or_insert_with(|| came.clone()));
                assert!(sharing.packing().packed >= pieces.len() as u64);
            }
        });
        let counts = sharing.packing();
        println!("{SESSIONS} sessions: {counts:?}");
        assert_eq!(counts.requests, SESSIONS as u64 * counts.packed);
        Stopper::stop(&stopper);
    });
}
