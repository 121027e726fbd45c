// What every page runs: it stays up to date, tells times in the reader's zone, and takes orders.

import { act } from "./actions.js";
import { choose } from "./choices.js";
import { follow } from "./live.js";
import { showTimes } from "./times.js";

showTimes(document);
act();
choose();
follow();
