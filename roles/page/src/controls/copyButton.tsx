/** A button that copies a text to the clipboard. */

import { useSignal } from "@preact/signals";
import { Button } from "./button.tsx";

/** Milliseconds for which it confirms the copy. */
const SHOWN = 1500;

export function CopyButton({ text, label }: { readonly text: string; readonly label: string }) {
  const isDone = useSignal(false);
  const copy = async () => {
    isDone.value = await copyText(text);
    setTimeout(() => {
      isDone.value = false;
    }, SHOWN);
  };
  const shown = isDone.value ? "Copied" : "Copy";
  return <Button text={shown} aria-label={label} title={label} onClick={() => void copy()} />;
}

/** Copies a text to the clipboard. Returns whether the browser allowed it. */
export async function copyText(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Without TLS, pages of other machines can only copy a selection.
    const field = document.createElement("textarea");
    field.value = text;
    document.body.append(field);
    field.select();
    const isCopied = document.execCommand("copy");
    field.remove();
    return isCopied;
  }
}
