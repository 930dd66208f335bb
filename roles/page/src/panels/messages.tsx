/** Messages on recent events and on a lost link: shown once, and removed after a while. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { withoutSecrets } from "../service/errors.ts";
import type { Viewer } from "../viewer/viewer.ts";

/** How long a message stays, milliseconds: at least, and per letter. */
const SHORTEST = 5000;
const EACH = 60;

export function Messages({ viewer }: { readonly viewer: Viewer }) {
  const { said, offer } = viewer;
  const trouble = viewer.session.trouble.value;
  /** The error that a person has closed. Another one is shown again. */
  const closed = useSignal("");
  /** The pointer or the focus is on it. */
  const isHeld = useSignal(false);
  useEffect(() => {
    const length = said.value.length + (offer.value?.text.length ?? 0);
    if (length === 0 || isHeld.value) {
      return;
    }
    const timer = setTimeout(
      () => {
        [said.value, offer.value] = ["", undefined];
      },
      SHORTEST + EACH * length,
    );
    return () => clearTimeout(timer);
  }, [said.value, offer.value, isHeld.value]);
  useEffect(() => {
    if (trouble === "") {
      closed.value = "";
    }
  }, [trouble]);
  const now = [trouble === closed.value ? "" : trouble, said.value, offer.value?.text ?? ""];
  const texts = now.filter((text) => text !== "");
  const hold = (isNow: boolean) => () => {
    isHeld.value = isNow;
  };
  const close = () => {
    [closed.value, said.value, offer.value, isHeld.value] = [trouble, "", undefined, false];
    viewer.canvas.focus({ preventScroll: true });
  };
  const accept = () => {
    offer.value?.run();
    close();
  };
  return (
    <div
      class={texts.length === 0 ? "messages" : "messages panel"}
      onPointerEnter={hold(true)}
      onPointerLeave={hold(false)}
      onFocusIn={hold(true)}
      onFocusOut={hold(false)}
    >
      <div id="status" role="status">
        {texts.map((text) => (
          <p key={text}>{withoutSecrets(text)}</p>
        ))}
      </div>
      {offer.value && <Button text={offer.value.label} onClick={accept} />}
      {texts.length > 0 && <Button text="×" aria-label="Close message" onClick={close} />}
    </div>
  );
}
