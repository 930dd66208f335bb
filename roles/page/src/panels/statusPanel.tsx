/** How the link, the picture and the page are, in plain words; figures for support are below them. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Choice } from "../controls/choice.tsx";
import { type Row, Rows } from "../controls/rows.tsx";
import { chooseTheme, THEMES, type Theme, theme } from "../controls/theme.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { plainRows } from "./plainRows.ts";
import { SupportDetails } from "./supportDetails.tsx";

const THEME_NAMES: Readonly<Record<Theme, string>> = {
  system: "as the system has them",
  light: "light",
  dark: "dark",
};
/** Milliseconds between two updates. */
const PERIOD = 500;

export function StatusPanel({ viewer }: { readonly viewer: Viewer }) {
  const rows = useSignal<readonly Row[]>([]);
  /** Its figures cost time while the eye moves: there are none while it is closed. */
  const hasDetails = useSignal(false);
  useEffect(() => {
    let [pictures, time] = [viewer.pictures, performance.now()];
    const look = () => {
      const now = performance.now();
      const { display, session, scene } = viewer;
      rows.value = plainRows({
        isLinked: display?.isOver === false,
        losses: session.losses,
        latency: display?.latency ?? 0,
        isExact: viewer.isExact,
        framesPerSecond: (1000 * (viewer.pictures - pictures)) / (now - time),
        memory: viewer.renderer.bytes,
        mostMemory: viewer.memory.peek(),
        service: location.host,
        scene: scene.name,
        objects: scene.objects,
      });
      [pictures, time] = [viewer.pictures, now];
    };
    const timer = setInterval(look, PERIOD);
    return () => clearInterval(timer);
  }, [viewer]);
  return (
    <section class="panel status" aria-label="Status">
      <Rows rows={rows.value} />
      <Choice
        label="Colours of the panels"
        options={THEMES.map((value) => ({ value, text: THEME_NAMES[value] }))}
        value={theme.value}
        onChoose={chooseTheme}
      />
      <details
        onToggle={({ currentTarget }) => {
          hasDetails.value = currentTarget.open;
        }}
      >
        <summary>Details for support</summary>
        {hasDetails.value && <SupportDetails viewer={viewer} />}
      </details>
    </section>
  );
}
