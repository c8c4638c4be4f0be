// The last script of a page that loads no data: it is ready as soon as its scripts have run.
"use strict";
document.body.dataset.ready = "yes";
