//! Futures that run at the same time in one task.

use std::future::poll_fn;
use std::pin::Pin;
use std::task::Poll;

/// Runs all at the same time, until each has succeeded or one has failed.
pub(crate) async fn try_all<F, T, E>(futures: impl IntoIterator<Item = F>) -> Result<Vec<T>, E>
where
    F: Future<Output = Result<T, E>>,
{
    let mut running: Vec<(Pin<Box<F>>, Option<T>)> =
        futures.into_iter().map(|future| (Box::pin(future), None)).collect();
    poll_fn(|cx| {
        let mut all = true;
        for (future, output) in running.iter_mut().filter(|(_, output)| output.is_none()) {
            match future.as_mut().poll(cx) {
                Poll::Ready(Ok(done)) => *output = Some(done),
                Poll::Ready(Err(error)) => return Poll::Ready(Err(error)),
                Poll::Pending => all = false,
            }
        }
        if all { Poll::Ready(Ok(())) } else { Poll::Pending }
    })
    .await?;
    Ok(running.into_iter().filter_map(|(_, output)| output).collect())
}

#[cfg(test)]
mod tests {
    use tokio::sync::oneshot;

    use super::*;

    #[tokio::test]
    async fn outputs_come_in_the_order_of_the_futures_and_the_first_error_ends_all() {
        let (first, one) = oneshot::channel::<u32>();
        let (second, other) = oneshot::channel();
        second.send(2).unwrap();
        let sends = async {
            tokio::task::yield_now().await;
            first.send(1).unwrap();
        };
        let (all, ()) = tokio::join!(try_all([one, other]), sends);
        assert_eq!(all, Ok(vec![1, 2]));
        let (_never, waits) = oneshot::channel::<u32>();
        let (fails, gone) = oneshot::channel();
        drop(fails);
        assert!(try_all([waits, gone]).await.is_err());
        assert_eq!(try_all::<oneshot::Receiver<u32>, _, _>([]).await, Ok(vec![]));
    }
}
