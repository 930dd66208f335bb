/** All that is beside the picture. */

import { useSignal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useMemo } from "preact/hooks";
import { NavigationBar } from "../navigate/bar.tsx";
import { told } from "../objects/actions.ts";
import { type Command, commandsOf, keyOf } from "../objects/commands.ts";
import { DetailsPanel } from "../objects/detailsPanel.tsx";
import { SearchBox } from "../objects/searchBox.tsx";
import { Selection } from "../objects/selection.ts";
import { TreePanel } from "../objects/treePanel.tsx";
import type { Viewer } from "../viewer/viewer.ts";

/** Shows the panels of `viewer` in `place`. */
export function showPanels(place: HTMLElement, viewer: Viewer): void {
  render(<App viewer={viewer} />, place);
}

function App({ viewer }: { readonly viewer: Viewer }) {
  const selection = useMemo(() => new Selection(viewer), [viewer]);
  const commands = useMemo(() => commandsOf(viewer, selection), [viewer, selection]);
  const isTreeOpen = useSignal(false);
  const toggleTree = () => {
    isTreeOpen.value = !isTreeOpen.value;
  };
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      if (event.target instanceof HTMLInputElement) {
        return;
      }
      const key = keyOf(event);
      const command = commands.find((command) => command.key === key);
      if (key === "Escape") {
        selection.clear();
      } else if (key === "T") {
        toggleTree();
      } else if (command?.isPossible()) {
        event.preventDefault();
        command.run();
      }
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, []);
  return (
    <>
      <div class="left">
        <div class="top">
          <button
            type="button"
            class="panel"
            title="The model as a tree (T)"
            aria-expanded={isTreeOpen.value}
            onClick={toggleTree}
          >
            Model
          </button>
          <SearchBox viewer={viewer} selection={selection} />
        </div>
        {isTreeOpen.value && <TreePanel viewer={viewer} selection={selection} />}
      </div>
      <DetailsPanel selection={selection} />
      <ViewBar viewer={viewer} commands={commands} />
      <NavigationBar navigator={viewer.navigator} />
      <p id="status" role="status">
        {viewer.session.trouble.value || viewer.said.value}
      </p>
    </>
  );
}

/** What can be done to objects: shown where something is picked, or something is changed already. */
function ViewBar({ viewer, commands }: { readonly viewer: Viewer; readonly commands: readonly Command[] }) {
  const changed = told(viewer.view.current.value);
  const { canUndo, canRedo } = viewer.view;
  if (viewer.selected.value.isEmpty && changed === "" && !canUndo.value && !canRedo.value) {
    return null;
  }
  return (
    <div class="panel bar objects" role="toolbar" aria-label="Objects">
      {commands.map(({ label, key, run, isPossible }) => (
        <button type="button" key={label} title={`${label} (${key})`} disabled={!isPossible()} onClick={run}>
          {label}
        </button>
      ))}
      {changed && <span>{changed}</span>}
    </div>
  );
}
