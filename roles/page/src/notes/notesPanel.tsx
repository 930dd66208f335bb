/** A list of the notes, the one that a person reads, and a new one. */

import { useSignal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { Button } from "../controls/button.tsx";
import { Choice } from "../controls/choice.tsx";
import { counted } from "../controls/counted.ts";
import { download } from "../controls/download.ts";
import type { Selection } from "../objects/selection.ts";
import { nameOf } from "../service/service.ts";
import type { Viewer } from "../viewer/viewer.ts";
import { type BcfVersion, fromBcf, type Note, type Status, toBcf, type WholeNote } from "./exchange.ts";
import { type Notes, notesOf } from "./notes.ts";

const STATUSES: readonly { readonly value: Status | ""; readonly text: string }[] = [
  { value: "open", text: "open" },
  { value: "closed", text: "closed" },
  { value: "", text: "all" },
];
const VERSIONS: readonly BcfVersion[] = ["2.1", "3.0"];

export function NotesPanel({
  viewer,
  selection,
}: {
  readonly viewer: Viewer;
  readonly selection: Selection;
}) {
  const notes = notesOf(viewer, selection);
  const isWriting = useSignal(false);
  useEffect(() => notes.watch(), [notes]);
  const list = notes.list.value;
  const open = notes.open.value;
  if (list === undefined) {
    return <p role="status">{notes.trouble.value}</p>;
  }
  const picked = selection.details.value;
  const about = picked ? nameOf(picked) : "what is in the middle of the picture";
  return (
    <section class="views notes" aria-label="Notes">
      {list.damaged.map((line) => (
        <p role="alert" key={line}>
          {line}
        </p>
      ))}
      {list.mayWrite && !isWriting.value && (
        <Button
          text="New note"
          title="About what is picked, or what is in the middle of the picture"
          onClick={() => {
            isWriting.value = true;
          }}
        />
      )}
      {isWriting.value && <p>{`About ${about}`}</p>}
      {isWriting.value && (
        <NoteForm
          notes={notes}
          label="Note"
          verb="Keep note"
          keep={(text) => notes.write(text)}
          onEnd={() => {
            isWriting.value = false;
          }}
        />
      )}
      <div>
        <Choice
          label="Status"
          options={STATUSES}
          value={notes.status.value}
          onChoose={(status) => notes.filter(status, notes.author.value)}
        />{" "}
        <Choice
          label="Author"
          options={["", ...notes.authors.value].map((value) => ({ value, text: value || "everybody" }))}
          value={notes.author.value}
          onChoose={(author) => notes.filter(notes.status.value, author)}
        />
      </div>
      <ul aria-label="Notes">
        {notes.shown.value.map((note) => (
          <li key={note.guid} class={notes.status.value === "closed" ? "" : note.status}>
            <Row notes={notes} note={note} isOpen={open?.guid === note.guid} />
            {open?.guid === note.guid && <Open notes={notes} note={open} mayWrite={list.mayWrite} />}
          </li>
        ))}
        {notes.shown.value.length === 0 && (
          <li>{list.notes.length === 0 ? "There are no notes yet." : "No note passes these filters."}</li>
        )}
      </ul>
      <Exchange notes={notes} mayWrite={list.mayWrite} />
    </section>
  );
}

function Row({
  notes,
  note,
  isOpen,
}: {
  readonly notes: Notes;
  readonly note: Note;
  readonly isOpen: boolean;
}) {
  const replies = note.replyCount === 0 ? "" : `, ${counted(note.replyCount, "reply", "replies")}`;
  return (
    <>
      <Button
        text={note.title}
        class="link"
        aria-expanded={isOpen}
        title="Go to its view"
        onClick={() => void notes.goTo(note.guid)}
      />
      <small>
        {note.author}, {dateText(note.date)}
        {replies}
        {note.status === "closed" && ", closed"}
      </small>
    </>
  );
}

/** A note with its replies, and what can be done with it. */
function Open({
  notes,
  note,
  mayWrite,
}: {
  readonly notes: Notes;
  readonly note: WholeNote;
  readonly mayWrite: boolean;
}) {
  const isReplying = useSignal(false);
  const other: Status = note.status === "open" ? "closed" : "open";
  return (
    <div class="note">
      {note.text && <p>{note.text}</p>}
      <ul aria-label="Replies">
        {note.replies.map(({ guid, author, date, text }) => (
          <li key={guid}>
            <small>
              {author}, {dateText(date)}
            </small>
            <p>{text}</p>
          </li>
        ))}
      </ul>
      {isReplying.value && (
        <NoteForm
          notes={notes}
          label="Reply"
          verb="Send reply"
          keep={(text) => notes.reply(text)}
          onEnd={() => {
            isReplying.value = false;
          }}
        />
      )}
      {mayWrite && !isReplying.value && (
        <div>
          <Button
            text="Reply"
            onClick={() => {
              isReplying.value = true;
            }}
          />
          <Button
            text={other === "closed" ? "Close note" : "Open again"}
            onClick={() => void notes.setStatus(other)}
          />
          {note.isOwn && <Button text="Delete note" onClick={() => void notes.delete()} />}
        </div>
      )}
    </div>
  );
}

/** A field for a text, and one for the person's name if the service does not know it. */
function NoteForm({
  notes,
  label,
  verb,
  keep,
  onEnd,
}: {
  readonly notes: Notes;
  readonly label: string;
  readonly verb: string;
  /** Returns whether the text was kept. */
  readonly keep: (text: string) => Promise<boolean>;
  readonly onEnd: () => void;
}) {
  const text = useSignal("");
  const isBusy = useSignal(false);
  const field = useRef<HTMLTextAreaElement>(null);
  // At once: the next key is for the text.
  useLayoutEffect(() => field.current?.focus(), []);
  const { you } = notes.list.value ?? {};
  const isNamed = you !== null || notes.name.value.trim() !== "";
  const send = async () => {
    isBusy.value = true;
    const isKept = await keep(text.value);
    isBusy.value = false;
    if (isKept) {
      onEnd();
    }
  };
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        void send();
      }}
      onKeyDown={(event) => {
        if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) {
          event.currentTarget.requestSubmit();
        } else if (event.key === "Escape") {
          onEnd();
        }
      }}
    >
      {you === null && (
        <input
          aria-label="Your name"
          placeholder="Your name"
          required
          maxLength={64}
          value={notes.name.value}
          onInput={({ currentTarget }) => notes.setName(currentTarget.value)}
        />
      )}
      <textarea
        ref={field}
        aria-label={label}
        placeholder={`${label}: the first line is its title`}
        rows={4}
        required
        maxLength={16_000}
        value={text.value}
        onInput={({ currentTarget }) => {
          text.value = currentTarget.value;
        }}
      />
      <div>
        <button type="submit" disabled={isBusy.value || text.value.trim() === "" || !isNamed}>
          {verb}
        </button>
        <Button text="Cancel" onClick={onEnd} />
      </div>
    </form>
  );
}

/** Export and import of BCF. */
function Exchange({ notes, mayWrite }: { readonly notes: Notes; readonly mayWrite: boolean }) {
  const version = useSignal<BcfVersion>("2.1");
  const { service, scene, said } = notes.viewer;
  const save = () =>
    notes.attempt(async () => download(await toBcf(service, version.value), `${scene.name}.bcf`));
  const take = (file: File | undefined) =>
    notes.attempt(async () => {
      if (file === undefined) {
        return;
      }
      const { notes: count, leftOut } = await fromBcf(service, file);
      await notes.refresh();
      const rest = leftOut.length === 0 ? "" : ` Left out: ${leftOut.join("; ")}.`;
      said.value = `${file.name} has ${counted(count, "note")}.${rest}`;
    });
  return (
    <div>
      <Button text="Save as BCF" onClick={() => void save()} />
      <Choice
        label="Version"
        options={VERSIONS.map((value) => ({ value, text: value }))}
        value={version.value}
        onChoose={(chosen) => {
          version.value = chosen;
        }}
      />
      {mayWrite && (
        <label class="file">
          Open BCF
          <input
            type="file"
            class="file-input"
            accept=".bcf,.bcfzip"
            onChange={(event) => {
              void take(event.currentTarget.files?.[0]);
              // Allows choosing the same file again.
              event.currentTarget.value = "";
            }}
          />
        </label>
      )}
    </div>
  );
}

/** A date in the person's time zone; as it is if the browser cannot read it. */
export function dateText(date: string): string {
  const time = new Date(date);
  return Number.isNaN(time.getTime())
    ? date
    : time.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}
