CREATE TABLE audit (
    number bigint NOT NULL,
    "time" double precision NOT NULL,
    owner text NOT NULL,
    action text NOT NULL,
    workspace text NOT NULL,
    target text NOT NULL,
    outcome text NOT NULL,
    address text NOT NULL,
    details text NOT NULL
);
CREATE TABLE dependency (
    job bigint NOT NULL,
    after bigint NOT NULL
);
CREATE TABLE event (
    number bigint NOT NULL,
    job bigint NOT NULL,
    job_id text NOT NULL,
    workspace text NOT NULL,
    "time" double precision NOT NULL,
    kind text NOT NULL,
    content text NOT NULL
);
CREATE TABLE job (
    number bigint NOT NULL,
    id text NOT NULL,
    kind text NOT NULL,
    workspace text NOT NULL,
    solution text NOT NULL,
    owner text NOT NULL,
    parameters text NOT NULL,
    priority integer NOT NULL,
    after text NOT NULL,
    key text NOT NULL,
    state text NOT NULL,
    tries bigint NOT NULL,
    submitted double precision NOT NULL,
    begun double precision,
    ended double precision,
    progress text NOT NULL,
    result text NOT NULL,
    error text NOT NULL,
    cancelling boolean NOT NULL,
    waits bigint NOT NULL,
    since double precision NOT NULL,
    until double precision NOT NULL,
    worker text NOT NULL,
    lease_s double precision NOT NULL,
    beat bigint NOT NULL,
    renewals bigint NOT NULL,
    losses bigint NOT NULL,
    notes bigint NOT NULL
);
CREATE TABLE setting (
    name text NOT NULL,
    value text NOT NULL
);
CREATE TABLE token (
    id text NOT NULL,
    digest text NOT NULL,
    owner text NOT NULL,
    name text NOT NULL,
    scopes text NOT NULL,
    created double precision NOT NULL,
    expires double precision,
    revoked double precision,
    last_used double precision
);
CREATE TABLE turn (
    owner text NOT NULL,
    turn bigint NOT NULL
);
CREATE TABLE upload (
    id text NOT NULL,
    workspace text NOT NULL,
    owner text NOT NULL,
    name text NOT NULL,
    kind text NOT NULL,
    size bigint NOT NULL,
    sha256 text NOT NULL,
    "offset" bigint NOT NULL,
    state text NOT NULL,
    created double precision NOT NULL,
    changed double precision NOT NULL
);
INSERT INTO audit VALUES (1, 1795473000.5, 'ada', 'submit', 'bennu', '00000001-01e6d868', 'accepted', '127.0.0.1', '{"n":1}');
INSERT INTO dependency VALUES (2, 1);
INSERT INTO event VALUES (1795473000500, 1, '00000001-01e6d868', 'bennu', 1795473000.5, 'state', '{"state":"waiting","tries":0}');
INSERT INTO event VALUES (1795473000501, 2, '00000002-60f86526', 'bennu', 1795473000.5, 'state', '{"state":"waiting","tries":0}');
INSERT INTO event VALUES (1795473000502, 3, '00000003-c8175f5e', 'eros', 1795473000.5, 'state', '{"state":"waiting","tries":0}');
INSERT INTO event VALUES (1795473000503, 1, '00000001-01e6d868', 'bennu', 1795473000.5, 'state', '{"state":"running","tries":1}');
INSERT INTO event VALUES (1795473000504, 1, '00000001-01e6d868', 'bennu', 1795473000.5, 'progress', '{"done":1,"remaining_s":3.5,"stage":"ingest","task":"files","total":2}');
INSERT INTO event VALUES (1795473000505, 1, '00000001-01e6d868', 'bennu', 1795473000.5, 'note', '{"text":"a line"}');
INSERT INTO event VALUES (1795473000506, 1, '00000001-01e6d868', 'bennu', 1795473000.5, 'state', '{"state":"finished","tries":1}');
INSERT INTO event VALUES (1795473000507, 3, '00000003-c8175f5e', 'eros', 1795473000.5, 'state', '{"state":"running","tries":1}');
INSERT INTO event VALUES (1795473000508, 3, '00000003-c8175f5e', 'eros', 1795473000.5, 'state', '{"error":{"code":"x","item":"BE0001","text":"is bad"},"state":"failed","tries":1}');
INSERT INTO job VALUES (1, '00000001-01e6d868', 'import', 'bennu', '', 'ada', '{"uploads":["f1"]}', 0, '[]', 'k1', 'finished', 1, 1795473000.5, 1795473000.5, 1795473000.5, '{"done":1,"remaining_s":3.5,"stage":"ingest","task":"files","total":2}', '{"ingest":{"scans":2}}', '', false, 0, 0, 0, 'w', 60, 2, 1, 0, 1);
INSERT INTO job VALUES (2, '00000002-60f86526', 'run', 'bennu', 'a', 'ada', '{"solution":"a","stages":["register"]}', 5, '["00000001-01e6d868"]', '', 'waiting', 0, 1795473000.5, NULL, NULL, '{}', '{}', '', false, 0, 0, 0, '', 0, 0, 0, 0, 0);
INSERT INTO job VALUES (3, '00000003-c8175f5e', 'run', 'eros', '', 'bea', '{}', 0, '[]', '', 'failed', 1, 1795473000.5, 1795473000.5, 1795473000.5, '{}', '{}', '{"code":"x","item":"BE0001","text":"is bad"}', false, 0, 0, 0, 'w', 60, 1, 0, 0, 0);
INSERT INTO setting VALUES ('version', '1');
INSERT INTO token VALUES ('30f82a771bf2', 'acb00670ee4ae7d22d5121ba447129a0bafbeefc0878d3352cc3631e5336887b', 'ada', 'notebook', '{"bennu":"run"}', 1795473000.5, NULL, NULL, NULL);
INSERT INTO turn VALUES ('ada', 1);
INSERT INTO turn VALUES ('bea', 2);
INSERT INTO upload VALUES ('b2f96b1682c936ee8a61d4f5bdb2cbe6', 'bennu', 'ada', 'a.laz', 'scan', 10, 'ab', 0, 'open', 1795473000.5, 1795473000.5);
ALTER TABLE ONLY audit
    ADD CONSTRAINT audit_pkey PRIMARY KEY (number);
ALTER TABLE ONLY dependency
    ADD CONSTRAINT dependency_pkey PRIMARY KEY (job, after);
ALTER TABLE ONLY event
    ADD CONSTRAINT event_pkey PRIMARY KEY (number);
ALTER TABLE ONLY job
    ADD CONSTRAINT job_id_key UNIQUE (id);
ALTER TABLE ONLY job
    ADD CONSTRAINT job_pkey PRIMARY KEY (number);
ALTER TABLE ONLY setting
    ADD CONSTRAINT setting_pkey PRIMARY KEY (name);
ALTER TABLE ONLY token
    ADD CONSTRAINT token_digest_key UNIQUE (digest);
ALTER TABLE ONLY token
    ADD CONSTRAINT token_pkey PRIMARY KEY (id);
ALTER TABLE ONLY turn
    ADD CONSTRAINT turn_pkey PRIMARY KEY (owner);
ALTER TABLE ONLY upload
    ADD CONSTRAINT upload_pkey PRIMARY KEY (id);
CREATE INDEX audit_workspace ON audit USING btree (workspace, number);
CREATE INDEX dependency_after ON dependency USING btree (after);
CREATE INDEX event_job ON event USING btree (job, number);
CREATE INDEX event_workspace ON event USING btree (workspace, number);
CREATE UNIQUE INDEX job_key ON job USING btree (owner, key) WHERE (key <> ''::text);
CREATE INDEX job_owner ON job USING btree (owner, number);
CREATE INDEX job_state ON job USING btree (state, workspace, solution);
CREATE INDEX job_workspace ON job USING btree (workspace, number);
CREATE INDEX upload_workspace ON upload USING btree (workspace, created);
