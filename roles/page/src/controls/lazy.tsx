/** A component whose code is loaded when it is first shown. */

import { signal } from "@preact/signals";
import type { FunctionComponent } from "preact";
import { useEffect } from "preact/hooks";

const GONE = "The service did not send this part of the page. Load the page again.";

/** The component that `load` gets by an `import()`. Until it is there, nothing is shown in its place. */
export function lazy<Properties>(
  load: () => Promise<FunctionComponent<Properties>>,
): FunctionComponent<Properties> {
  const loaded = signal<FunctionComponent<Properties> | undefined>(undefined);
  const failure = signal("");
  const begin = async () => {
    try {
      failure.value = "";
      loaded.value = await load();
    } catch {
      failure.value = GONE;
    }
  };
  return (properties) => {
    useEffect(() => {
      if (loaded.peek() === undefined) {
        void begin();
      }
    }, []);
    const Loaded = loaded.value;
    return Loaded === undefined ? (
      failure.value && <p role="alert">{failure.value}</p>
    ) : (
      <Loaded {...properties} />
    );
  };
}
