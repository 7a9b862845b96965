// Keeps the page's files, so that it works without a network once loaded. The build writes VERSION and FILES. Other pages
// of the origin have caches, too: those of this page begin with OWN.
const OWN = "ocisac ";
const VERSION = `${OWN}@VERSION@`;
const FILES = "@FILES@".split(" ");

self.addEventListener("install", (installed) => {
  const fresh = FILES.map((file) => new Request(file, { cache: "reload" }));  // not those of the version before
  installed.waitUntil(caches.open(VERSION).then((cache) => cache.addAll(fresh)).then(() => self.skipWaiting()));
});
self.addEventListener("activate", (active) => {
  const isOld = (name) => name.startsWith(OWN) && name !== VERSION;
  const old = (names) => names.filter(isOld).map((name) => caches.delete(name));
  active.waitUntil(caches.keys().then((names) => Promise.all(old(names))).then(() => self.clients.claim()));
});
self.addEventListener("fetch", (fetched) => {
  if (new URL(fetched.request.url).origin !== self.location.origin) return;
  const options = { ignoreSearch: true, cacheName: VERSION };
  fetched.respondWith(caches.match(fetched.request, options).then((kept) => kept ?? fetch(fetched.request)));
});
