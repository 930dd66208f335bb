/** A panel beside the picture, with its name and a button that closes it. */

import type { ComponentChildren } from "preact";
import { Button } from "./button.tsx";

export function Panel({
  name,
  onClose,
  children,
}: {
  readonly name: string;
  readonly onClose: () => void;
  readonly children: ComponentChildren;
}) {
  return (
    <div class="panel frame" id={`panel-${name}`}>
      <header>
        <h2>{name}</h2>
        <Button text="×" aria-label={`Close ${name}`} onClick={onClose} />
      </header>
      {children}
    </div>
  );
}
