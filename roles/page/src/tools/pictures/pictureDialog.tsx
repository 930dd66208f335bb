/** Takes a picture of a chosen size with its caption, for a file or for paper. */

import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { Button } from "../../controls/button.tsx";
import { Choice } from "../../controls/choice.tsx";
import { download } from "../../controls/download.ts";
import { messageOf } from "../../service/errors.ts";
import type { PartDetails } from "../../service/service.ts";
import type { Size } from "../../space/size.ts";
import type { Viewer } from "../../viewer/viewer.ts";
import { captionText } from "./caption.ts";
import { type Layout, largest, layoutOf } from "./layout.ts";
import { PAPERS, type Paper, PRINTED, paperLayout, print } from "./print.ts";
import { clearSheet } from "./sheet.ts";
import { pngOf, takePicture } from "./takePicture.ts";

const SIZES: readonly Size[] = [
  { width: 1920, height: 1080 },
  { width: 3840, height: 2160 },
];
/** The most letters of an own text: more would be too narrow to read. */
const LONGEST = 80;

interface Properties {
  readonly viewer: Viewer;
  /** The name of the view or of the picked part. */
  readonly subject: string;
  readonly picked: PartDetails | undefined;
  readonly onClose: () => void;
}

/** A picture that is being taken. */
interface Work {
  readonly text: string;
  readonly share: number;
  readonly stop: () => void;
}

export function PictureDialog({ viewer, subject, picked, onClose }: Properties) {
  const dialog = useRef<HTMLDialogElement>(null);
  const { canvas } = viewer;
  const screen = { width: canvas.width, height: canvas.height };
  /** One of the listed sizes; nothing for the screen's. */
  const size = useSignal<Size | undefined>(undefined);
  const own = useSignal<Size>(SIZES[0] ?? screen);
  const isOwn = useSignal(false);
  const keepsShape = useSignal(false);
  const isCaptioned = useSignal(true);
  const hasDimensions = useSignal(true);
  const paper = useSignal<Paper>("A4");
  const work = useSignal<Work | undefined>(undefined);
  const fault = useSignal("");
  useEffect(() => {
    viewer.navigator.release();
    dialog.current?.showModal();
    return () => {
      work.peek()?.stop();
      clearSheet();
    };
  }, []);
  const [width, height] = viewer.scene.maxPicture;
  const most = { width, height };
  const limits = largest(most);
  const wishedLayout = () => {
    const wanted = isOwn.peek() ? own.peek() : (size.peek() ?? screen);
    const isScreen = !isOwn.peek() && size.peek() === undefined;
    const wish = { size: wanted, keepsShape: isScreen || keepsShape.peek(), isCaptioned: isCaptioned.peek() };
    return layoutOf(wish, screen, most);
  };
  const take = async (
    layout: () => Layout,
    use: (canvas: HTMLCanvasElement) => Promise<void>,
    printedHeight?: number,
  ) => {
    const stopper = new AbortController();
    const stop = () => stopper.abort();
    try {
      fault.value = "";
      const onProgress = (stage: "culling" | "drawing", share: number) => {
        work.value = { text: stage === "culling" ? "Finds what shows" : "Draws", share, stop };
      };
      const order = {
        layout: layout(),
        printedHeight,
        text: captionText.peek(),
        subject,
        picked,
        hasDimensions: hasDimensions.peek(),
        signal: stopper.signal,
        onProgress,
      };
      await use(await takePicture(viewer, order));
    } catch (error) {
      fault.value = stopper.signal.aborted ? "" : `There is no picture: ${messageOf(error)}.`;
    } finally {
      work.value = undefined;
    }
  };
  const save = () =>
    take(wishedLayout, async (canvas) => download(await pngOf(canvas), `${viewer.scene.name}.png`));
  const printIt = () =>
    take(
      () => paperLayout(paper.peek(), isCaptioned.peek(), most),
      async (canvas) => print(await pngOf(canvas), paper.peek()),
      PRINTED[paper.peek()],
    );
  return (
    <dialog ref={dialog} class="picture" aria-label="Picture" onClose={onClose}>
      <Choice
        label="Size"
        options={[
          { value: "screen", text: `the screen's, ${screen.width} x ${screen.height}` },
          ...SIZES.map(({ width, height }, at) => ({ value: String(at), text: `${width} x ${height}` })),
          { value: "own", text: "other" },
        ]}
        value={isOwn.value ? "own" : size.value ? String(SIZES.indexOf(size.value)) : "screen"}
        onChoose={(chosen) => {
          [isOwn.value, size.value] = [chosen === "own", SIZES[Number(chosen)]];
        }}
      />
      {isOwn.value && (
        <span class="sides">
          {(["width", "height"] as const).map((side) => (
            <input
              key={side}
              type="number"
              min={1}
              max={limits[side]}
              aria-label={`${side === "width" ? "Width" : "Height"} in pixels`}
              value={own.value[side]}
              onChange={({ currentTarget }) => {
                own.value = { ...own.peek(), [side]: currentTarget.valueAsNumber };
              }}
            />
          ))}
        </span>
      )}
      <Check text="Keep the proportions of the screen" of={keepsShape} />
      <Check text="Caption" of={isCaptioned} />
      {isCaptioned.value && (
        <label>
          Text in the caption{" "}
          <input
            type="text"
            maxLength={LONGEST}
            value={captionText.value}
            onInput={({ currentTarget }) => {
              captionText.value = currentTarget.value;
            }}
          />
        </label>
      )}
      {viewer.distances.value.length > 0 && <Check text="Dimensions" of={hasDimensions} />}
      <p>
        <Button text="Save the picture" disabled={work.value !== undefined} onClick={() => void save()} />
      </p>
      <p>
        <Choice
          label="Paper"
          options={PAPERS.map((value) => ({ value, text: `${value}, landscape` }))}
          value={paper.value}
          onChoose={(chosen) => {
            paper.value = chosen;
          }}
        />
        <Button text="Print" disabled={work.value !== undefined} onClick={() => void printIt()} />
      </p>
      {work.value && (
        <p role="status">
          {work.value.text} <progress value={work.value.share} aria-label="How much of the picture is done" />
          <Button text="Stop" onClick={work.value.stop} />
        </p>
      )}
      {fault.value && <p role="alert">{fault.value}</p>}
      <form method="dialog">
        <button type="submit">Close</button>
      </form>
    </dialog>
  );
}

function Check({ text, of }: { readonly text: string; readonly of: Signal<boolean> }) {
  return (
    <label>
      <input
        type="checkbox"
        checked={of.value}
        onChange={(event) => {
          of.value = event.currentTarget.checked;
        }}
      />{" "}
      {text}
    </label>
  );
}
