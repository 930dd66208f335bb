/** Everything beside the picture. */

import { useSignal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useMemo } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { lazy } from "../controls/lazy.tsx";
import { Panel } from "../controls/panel.tsx";
import { NavigationBar } from "../navigate/bar.tsx";
import { STANDARD_VIEWS, type StandardView } from "../navigate/standardViews.ts";
import { TouchPad } from "../navigate/touchPad.tsx";
import { isForControl } from "../navigate/typing.ts";
import { told } from "../objects/actions.ts";
import { type Command, commandsOf, keyOf, lookFrom, navigationCommandsOf } from "../objects/commands.ts";
import { Finding } from "../objects/finding.ts";
import { SearchBox } from "../objects/searchBox.tsx";
import { Selection } from "../objects/selection.ts";
import { KeptViewpoints } from "../tools/kept.ts";
import { MeasureOverlay } from "../tools/measureOverlay.tsx";
import { Measuring } from "../tools/measuring.ts";
import { Orientation } from "../tools/orientation.tsx";
import { People } from "../viewer/people.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { enterPanel, keepFocus } from "./focus.ts";
import { Hint } from "./hint.tsx";
import { Messages } from "./messages.tsx";

const PeopleOverlay = lazy(async () => (await import("../tools/peopleOverlay.tsx")).PeopleOverlay);
const Following = lazy(async () => (await import("../tools/peopleOverlay.tsx")).Following);
const SectionsOverlay = lazy(async () => (await import("../tools/sectionsOverlay.tsx")).SectionsOverlay);
const SectionsPanel = lazy(async () => (await import("../tools/sectionsPanel.tsx")).SectionsPanel);
const TreePanel = lazy(async () => (await import("../objects/treePanel.tsx")).TreePanel);
const DetailsPanel = lazy(async () => (await import("../objects/detailsPanel.tsx")).DetailsPanel);
const ColoursPanel = lazy(async () => (await import("../objects/coloursPanel.tsx")).ColoursPanel);
const MeasurePanel = lazy(async () => (await import("../tools/measurePanel.tsx")).MeasurePanel);
const PickedOverlay = lazy(async () => (await import("../objects/pickedOverlay.tsx")).PickedOverlay);
const PolygonOverlay = lazy(async () => (await import("../tools/polygonOverlay.tsx")).PolygonOverlay);
const WhereOverlay = lazy(async () => (await import("./wherePanel.tsx")).WhereOverlay);
const WherePanel = lazy(async () => (await import("./wherePanel.tsx")).WherePanel);
const NotesOverlay = lazy(async () => (await import("../notes/notesOverlay.tsx")).NotesOverlay);
const NotesPanel = lazy(async () => (await import("../notes/notesPanel.tsx")).NotesPanel);
const ClashPanel = lazy(async () => (await import("../clearance/clashPanel.tsx")).ClashPanel);
const Things = lazy(async () => (await import("../clearance/things.tsx")).Things);
const ViewsPanel = lazy(async () => (await import("../tools/viewsPanel.tsx")).ViewsPanel);
const StatusPanel = lazy(async () => (await import("./statusPanel.tsx")).StatusPanel);

/** Panels of which one is open at a time, with their keys. */
const PANEL_KEYS = {
  T: "Model",
  B: "Cut",
  M: "Measure",
  J: "Where",
  Y: "Colours",
  N: "Notes",
  O: "Clashes",
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
      return measuring.isOn.peek() && measuring.pick(x, y);
    });
  }, [viewer, measuring]);
  const finding = useMemo(() => new Finding(viewer), [viewer]);
  const kept = useMemo(() => new KeptViewpoints(viewer.scene), [viewer]);
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
  /** Prints the picture as its dialog does. */
  const print = async () => {
    people.follow(undefined);
    const { printNow } = await import("../tools/pictures/printNow.ts");
    const { nameOfView } = await import("../tools/views.ts");
    const picked = selection.details.peek();
    await printNow(viewer, picked?.name || nameOfView(viewer, kept.list.peek()), picked);
  };
  /** Leaves a panel, or undoes the last measured point, or ends measuring, or clears the selection. */
  const stepBack = () => {
    const isInPanel = document.activeElement?.closest(".frame, .details") != null;
    viewer.canvas.focus({ preventScroll: true });
    if (isInPanel || measuring.takeBack()) {
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
      } else if (
        (key === "Enter" && !event.repeat && measuring.enter()) ||
        (key === "Backspace" && measuring.takeBack())
      ) {
        event.preventDefault();
      } else if (key === "Ctrl+P") {
        event.preventDefault();
        // Without the service's file the browser prints what the screen shows.
        print().catch(() => window.print());
      } else if (event.key === "?") {
        event.preventDefault();
        if (!event.repeat) {
          document.getElementById("open-keys")?.click();
        }
      } else if (key === "K") {
        selection.nextLevel();
      } else if (standard !== undefined) {
        look(standard);
      } else if (isPanelKey(key)) {
        event.preventDefault();
        const panel = PANEL_KEYS[key];
        toggle(panel);
        if (open.peek() === panel) {
          enterPanel(panel, key);
        }
      } else if (command !== undefined) {
        // The browser would leave the page, or choose from the list that has the focus.
        event.preventDefault();
        if (command.isPossible()) {
          command.run();
        }
      }
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, []);
  useEffect(() => {
    if (window.parent !== window) {
      void import("../embedding/embedding.ts").then(({ embed }) => embed({ viewer, selection, people }));
    }
  }, []);
  return (
    <>
      <MeasureOverlay viewer={viewer} measuring={measuring} />
      {open.value === "Measure" && <PolygonOverlay viewer={viewer} measuring={measuring} />}
      {selection.count.value > 0 && <PickedOverlay viewer={viewer} selection={selection} />}
      {open.value === "Cut" && <SectionsOverlay viewer={viewer} />}
      {open.value === "Where" && <WhereOverlay viewer={viewer} />}
      {open.value === "Notes" && <NotesOverlay viewer={viewer} selection={selection} />}
      <Others viewer={viewer} people={people} />
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
          <SearchBox viewer={viewer} selection={selection} finding={finding} kept={kept} />
        </div>
        {open.value && (
          <Panel name={open.value} onClose={() => close(open.value)}>
            {open.value === "Model" && <TreePanel viewer={viewer} selection={selection} />}
            {open.value === "Cut" && <SectionsPanel viewer={viewer} bounds={selection.bounds.value} />}
            {open.value === "Where" && <WherePanel viewer={viewer} selection={selection} />}
            {open.value === "Notes" && <NotesPanel viewer={viewer} selection={selection} />}
            {open.value === "Measure" && (
              <MeasurePanel viewer={viewer} measuring={measuring}>
                <Things viewer={viewer} selection={selection} />
              </MeasurePanel>
            )}
            {open.value === "Clashes" && (
              <ClashPanel viewer={viewer} selection={selection} isClosed={() => open.peek() === undefined} />
            )}
            {open.value === "Status" && <StatusPanel viewer={viewer} />}
            {open.value === "Colours" && <ColoursPanel viewer={viewer} selection={selection} />}
            {open.value === "Views" && (
              <ViewsPanel
                viewer={viewer}
                people={people}
                kept={kept}
                openSet={(query) => void finding.show(query)}
                picked={selection.details.value}
              />
            )}
          </Panel>
        )}
      </div>
      <Orientation viewer={viewer} look={look} commands={moves} views={STANDARD_VIEWS} />
      {selection.details.value && <DetailsPanel selection={selection} />}
      <div class="bottom">
        <Hint viewer={viewer} />
        <Messages viewer={viewer} />
        <TouchPad navigator={viewer.navigator} />
        {open.value !== "Views" && people.followed.value !== undefined && <Following people={people} />}
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

/** The other people in the picture. They send their poses often: only this is rendered again then. */
function Others({ viewer, people }: { readonly viewer: Viewer; readonly people: People }) {
  const isAlone = people.company.value.others.length === 0;
  return isAlone ? null : <PeopleOverlay viewer={viewer} people={people} />;
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
  const isIdle = viewer.selected.value.isEmpty;
  if (isIdle && changed === "" && !canUndo.value && !canRedo.value) {
    return null;
  }
  return (
    <fieldset class={`panel bar objects${isIdle ? " idle" : ""}`} aria-label="Objects">
      <Button
        text="Pick more"
        title="A click picks one object more, as with Ctrl"
        disabled={isIdle}
        aria-pressed={viewer.picksMore.value}
        onClick={() => {
          viewer.picksMore.value = !viewer.picksMore.value;
        }}
      />
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
