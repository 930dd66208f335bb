/** Waiting in step with the pictures of a page. */

/** Waits until `holds` at the time of a picture. */
export function until(holds: () => boolean): Promise<void> {
  return each(() => !holds());
}

/** Calls `step` before each picture, until it returns false. */
export function each(step: (now: number) => boolean): Promise<void> {
  return new Promise((resolve) => {
    const next = () => {
      if (step(performance.now())) {
        requestAnimationFrame(next);
      } else {
        resolve();
      }
    };
    requestAnimationFrame(next);
  });
}
