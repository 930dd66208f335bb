/** A button that sends no form. */

import type { ComponentChildren, ComponentProps } from "preact";

export function Button({ text, ...more }: ComponentProps<"button"> & { readonly text: ComponentChildren }) {
  return (
    <button type="button" {...more}>
      {text}
    </button>
  );
}
