/** Everything beside the picture. */

import { useSignal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useMemo } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { Panel } from "../controls/panel.tsx";
import { NavigationBar } from "../navigate/bar.tsx";
import { STANDARD_VIEWS, type StandardView } from "../navigate/standardViews.ts";
import { TouchPad } from "../navigate/touchPad.tsx";
import { isForControl } from "../navigate/typing.ts";
import { told } from "../objects/actions.ts";
import { type Command, commandsOf, keyOf, lookFrom, navigationCommandsOf } from "../objects/commands.ts";
import { DetailsPanel } from "../objects/detailsPanel.tsx";
import { SearchBox } from "../objects/searchBox.tsx";
import { Selection } from "../objects/selection.ts";
import { TreePanel } from "../objects/treePanel.tsx";
import { MeasureOverlay } from "../tools/measureOverlay.tsx";
import { MeasurePanel } from "../tools/measurePanel.tsx";
import { Measuring } from "../tools/measuring.ts";
import { Orientation } from "../tools/orientation.tsx";
import { SectionsOverlay } from "../tools/sectionsOverlay.tsx";
import { SectionsPanel } from "../tools/sectionsPanel.tsx";
import { ViewsPanel } from "../tools/viewsPanel.tsx";
import { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { keepFocus } from "./focus.ts";
import { Hint } from "./hint.tsx";
import { Messages } from "./messages.tsx";
import { StatusPanel } from "./statusPanel.tsx";

/** Panels of which one is open at a time, with their keys. */
const PANEL_KEYS = {
  T: "Model",
  B: "Cut",
  M: "Measure",
  V: "Views",
  P: "Status",
} as const satisfies Readonly<Record<string, string>>;
type PanelName = (typeof PANEL_KEYS)[keyof typeof PANEL_KEYS];

/** Shows the panels of `viewer` in `place`. */
export function showPanels(place: HTMLElement, viewer: Viewer): void {
  render(<App viewer={viewer} />, place);
  keepFocus(place, viewer.canvas);
}

function App({ viewer }: { readonly viewer: Viewer }) {
  const measuring = useMemo(() => new Measuring(viewer), [viewer]);
  const people = useMemo(() => new People(viewer), [viewer]);
  const selection = useMemo(() => {
    return new Selection(viewer, (x, y) => {
      if (measuring.isOn.peek()) {
        measuring.pick(x, y);
      }
      return measuring.isOn.peek();
    });
  }, [viewer, measuring]);
  const open = useSignal<PanelName | undefined>(undefined);
  const toggle = (panel: PanelName) => {
    open.value = open.value === panel ? undefined : panel;
    if ((open.value === "Measure") !== measuring.isOn.peek()) {
      measuring.toggle();
    }
  };
  const commands = useMemo(() => {
    const openTree = () => {
      if (open.peek() !== "Model") {
        toggle("Model");
      }
    };
    return commandsOf(viewer, selection, measuring, openTree);
  }, [viewer]);
  const moves = useMemo(() => navigationCommandsOf(viewer), [viewer]);
  const look = (view: StandardView) => lookFrom(viewer, selection, view);
  const close = (panel: PanelName | undefined) => {
    if (panel !== undefined) {
      toggle(panel);
      document.getElementById(`open-${panel}`)?.focus();
    }
  };
  /** Undoes the last measured point, or leaves a panel, or ends measuring, or clears the selection. */
  const stepBack = () => {
    const isInPanel = document.activeElement?.closest(".frame") != null;
    viewer.canvas.focus({ preventScroll: true });
    // Leaves a panel first; the selection stays.
    if (measuring.takeBack() || isInPanel) {
      return;
    }
    if (measuring.isOn.peek()) {
      toggle("Measure");
    } else {
      selection.clear();
    }
  };
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      if (isForControl(event)) {
        return;
      }
      const key = keyOf(event);
      const command = [...commands, ...moves].find((command) => command.key === key);
      const standard = STANDARD_VIEWS.find((view) => view.key === key);
      if (key === "Escape") {
        stepBack();
      } else if (key === "K") {
        selection.nextLevel();
      } else if (standard !== undefined) {
        look(standard);
      } else if (isPanelKey(key)) {
        event.preventDefault();
        toggle(PANEL_KEYS[key]);
      } else if (command?.isPossible()) {
        event.preventDefault();
        command.run();
      } else if (command !== undefined && event.altKey) {
        // The browser would leave the page.
        event.preventDefault();
      }
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, []);
  return (
    <>
      <MeasureOverlay viewer={viewer} measuring={measuring} />
      {open.value === "Cut" && <SectionsOverlay viewer={viewer} />}
      <div class="left">
        <div class="top">
          {Object.entries(PANEL_KEYS).map(([key, panel]) => (
            <Button
              text={panel}
              class="panel"
              key={key}
              id={`open-${panel}`}
              title={`${panel} (${key})`}
              aria-expanded={open.value === panel}
              onClick={() => toggle(panel)}
            />
          ))}
          <SearchBox viewer={viewer} selection={selection} />
        </div>
        {open.value && (
          <Panel name={open.value} onClose={() => close(open.value)}>
            {open.value === "Model" && <TreePanel viewer={viewer} selection={selection} />}
            {open.value === "Cut" && <SectionsPanel viewer={viewer} bounds={selection.bounds.value} />}
            {open.value === "Measure" && <MeasurePanel viewer={viewer} measuring={measuring} />}
            {open.value === "Status" && <StatusPanel viewer={viewer} />}
            {open.value === "Views" && <ViewsPanel viewer={viewer} people={people} />}
          </Panel>
        )}
      </div>
      <Orientation viewer={viewer} look={look} commands={moves} views={STANDARD_VIEWS} />
      <DetailsPanel selection={selection} />
      <div class="bottom">
        <Hint viewer={viewer} />
        <Messages viewer={viewer} />
        <TouchPad navigator={viewer.navigator} />
        <ViewBar viewer={viewer} commands={commands} />
        <NavigationBar navigator={viewer.navigator}>
          <LevelChoice selection={selection} />
        </NavigationBar>
      </div>
    </>
  );
}

function isPanelKey(key: string): key is keyof typeof PANEL_KEYS {
  return key in PANEL_KEYS;
}

/** The level at which a click picks, if the model has several. */
function LevelChoice({ selection }: { readonly selection: Selection }) {
  return selection.levels.length === 1 ? null : (
    <Choice
      label="Picks"
      options={selection.levels.map((level) => ({ value: level, text: level }))}
      value={selection.level.value}
      onChoose={(level) => selection.setLevel(level)}
    />
  );
}

/** The actions on objects, shown if something is picked or already changed. */
function ViewBar({ viewer, commands }: { readonly viewer: Viewer; readonly commands: readonly Command[] }) {
  const { canUndo, canRedo, current, modelSeeThrough } = viewer.view;
  const changed = told(current.value, viewer.scene.objects, modelSeeThrough);
  if (viewer.selected.value.isEmpty && changed === "" && !canUndo.value && !canRedo.value) {
    return null;
  }
  return (
    <fieldset class="panel bar objects" aria-label="Objects">
      {!viewer.selected.value.isEmpty && (
        <Button
          text="Pick more"
          title="A click picks one object more, as with Ctrl"
          aria-pressed={viewer.picksMore.value}
          onClick={() => {
            viewer.picksMore.value = !viewer.picksMore.value;
          }}
        />
      )}
      {commands.map(({ label, key, run, isPossible, isOn }) => (
        <Button
          text={label}
          key={label}
          title={`${label} (${key})`}
          disabled={!isPossible()}
          aria-pressed={isOn?.()}
          onClick={run}
        />
      ))}
      {changed && <span>{changed}</span>}
    </fieldset>
  );
}
