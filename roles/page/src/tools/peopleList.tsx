/** The other people here, and what can be done with them. */

import { Button } from "../controls/button.tsx";
import { called, type PartDetails } from "../service/service.ts";
import type { People } from "../viewer/people.ts";

/** Empty if there are none. */
export function PeopleList({
  people,
  picked,
}: {
  readonly people: People;
  readonly picked: PartDetails | undefined;
}) {
  const { you, others } = people.company.value;
  const { followed } = people;
  return (
    <>
      <ul aria-label="People">
        {others.length > 0 && <li>You are person {you}</li>}
        {others.map((person) => (
          <li key={person.number}>
            <Button
              text={called(person)}
              class="link"
              title="Follow"
              onClick={() => people.follow(person.number)}
            />
            <Button
              text="Follow"
              aria-pressed={followed.value === person.number}
              onClick={() => people.follow(followed.value === person.number ? undefined : person.number)}
            />
          </li>
        ))}
      </ul>
      {others.length > 0 && (
        <div>
          <Button
            text="Bring all here"
            title="The others are asked to come to where you are"
            onClick={() => people.bringAll()}
          />
          <Button
            text="Point it out"
            title="The part that is picked is marked in the pictures of all"
            disabled={picked === undefined}
            onClick={() => picked && people.pointOut(picked)}
          />
          <Button
            text="Go on from here"
            title="Ends following, and keeps what is cut, hidden and see-through"
            disabled={followed.value === undefined}
            onClick={() => people.goOnAlone()}
          />
        </div>
      )}
    </>
  );
}
