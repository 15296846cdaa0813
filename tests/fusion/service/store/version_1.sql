BEGIN TRANSACTION;
CREATE TABLE audit (
	number BIGINT NOT NULL,
	time DOUBLE NOT NULL,
	owner TEXT NOT NULL,
	action TEXT NOT NULL,
	workspace TEXT NOT NULL,
	target TEXT NOT NULL,
	outcome TEXT NOT NULL,
	address TEXT NOT NULL,
	details TEXT NOT NULL,
	PRIMARY KEY (number)
);
INSERT INTO "audit" VALUES(1,1795473000.5,'ada','submit','bennu','00000001-01e6d868','accepted','127.0.0.1','{"n":1}');
CREATE TABLE dependency (
	job BIGINT NOT NULL,
	"after" BIGINT NOT NULL,
	PRIMARY KEY (job, "after")
);
INSERT INTO "dependency" VALUES(2,1);
CREATE TABLE event (
	number BIGINT NOT NULL,
	job BIGINT NOT NULL,
	job_id TEXT NOT NULL,
	workspace TEXT NOT NULL,
	time DOUBLE NOT NULL,
	kind TEXT NOT NULL,
	content TEXT NOT NULL,
	PRIMARY KEY (number)
);
INSERT INTO "event" VALUES(1795473000500,1,'00000001-01e6d868','bennu',1795473000.5,'state','{"state":"waiting","tries":0}');
INSERT INTO "event" VALUES(1795473000501,2,'00000002-60f86526','bennu',1795473000.5,'state','{"state":"waiting","tries":0}');
INSERT INTO "event" VALUES(1795473000502,3,'00000003-c8175f5e','eros',1795473000.5,'state','{"state":"waiting","tries":0}');
INSERT INTO "event" VALUES(1795473000503,1,'00000001-01e6d868','bennu',1795473000.5,'state','{"state":"running","tries":1}');
INSERT INTO "event" VALUES(1795473000504,1,'00000001-01e6d868','bennu',1795473000.5,'progress','{"done":1,"remaining_s":3.5,"stage":"ingest","task":"files","total":2}');
INSERT INTO "event" VALUES(1795473000505,1,'00000001-01e6d868','bennu',1795473000.5,'note','{"text":"a line"}');
INSERT INTO "event" VALUES(1795473000506,1,'00000001-01e6d868','bennu',1795473000.5,'state','{"state":"finished","tries":1}');
INSERT INTO "event" VALUES(1795473000507,3,'00000003-c8175f5e','eros',1795473000.5,'state','{"state":"running","tries":1}');
INSERT INTO "event" VALUES(1795473000508,3,'00000003-c8175f5e','eros',1795473000.5,'state','{"error":{"code":"x","item":"BE0001","text":"is bad"},"state":"failed","tries":1}');
CREATE TABLE job (
	number BIGINT NOT NULL,
	id TEXT NOT NULL,
	kind TEXT NOT NULL,
	workspace TEXT NOT NULL,
	solution TEXT NOT NULL,
	owner TEXT NOT NULL,
	parameters TEXT NOT NULL,
	priority INTEGER NOT NULL,
	"after" TEXT NOT NULL,
	"key" TEXT NOT NULL,
	state TEXT NOT NULL,
	tries BIGINT NOT NULL,
	submitted DOUBLE NOT NULL,
	begun DOUBLE,
	ended DOUBLE,
	progress TEXT NOT NULL,
	result TEXT NOT NULL,
	error TEXT NOT NULL,
	cancelling BOOLEAN NOT NULL,
	waits BIGINT NOT NULL,
	since DOUBLE NOT NULL,
	until DOUBLE NOT NULL,
	worker TEXT NOT NULL,
	lease_s DOUBLE NOT NULL,
	beat BIGINT NOT NULL,
	renewals BIGINT NOT NULL,
	losses BIGINT NOT NULL,
	notes BIGINT NOT NULL,
	PRIMARY KEY (number),
	UNIQUE (id)
);
INSERT INTO "job" VALUES(1,'00000001-01e6d868','import','bennu','','ada','{"uploads":["f1"]}',0,'[]','k1','finished',1,1795473000.5,1795473000.5,1795473000.5,'{"done":1,"remaining_s":3.5,"stage":"ingest","task":"files","total":2}','{"ingest":{"scans":2}}','',0,0,0.0,0.0,'w',60.0,2,1,0,1);
INSERT INTO "job" VALUES(2,'00000002-60f86526','run','bennu','a','ada','{"solution":"a","stages":["register"]}',5,'["00000001-01e6d868"]','','waiting',0,1795473000.5,NULL,NULL,'{}','{}','',0,0,0.0,0.0,'',0.0,0,0,0,0);
INSERT INTO "job" VALUES(3,'00000003-c8175f5e','run','eros','','bea','{}',0,'[]','','failed',1,1795473000.5,1795473000.5,1795473000.5,'{}','{}','{"code":"x","item":"BE0001","text":"is bad"}',0,0,0.0,0.0,'w',60.0,1,0,0,0);
CREATE TABLE setting (
	name TEXT NOT NULL,
	value TEXT NOT NULL,
	PRIMARY KEY (name)
);
INSERT INTO "setting" VALUES('version','1');
CREATE TABLE token (
	id TEXT NOT NULL,
	digest TEXT NOT NULL,
	owner TEXT NOT NULL,
	name TEXT NOT NULL,
	scopes TEXT NOT NULL,
	created DOUBLE NOT NULL,
	expires DOUBLE,
	revoked DOUBLE,
	last_used DOUBLE,
	PRIMARY KEY (id),
	UNIQUE (digest)
);
INSERT INTO "token" VALUES('30f82a771bf2','acb00670ee4ae7d22d5121ba447129a0bafbeefc0878d3352cc3631e5336887b','ada','notebook','{"bennu":"run"}',1795473000.5,NULL,NULL,NULL);
CREATE TABLE turn (
	owner TEXT NOT NULL,
	turn BIGINT NOT NULL,
	PRIMARY KEY (owner)
);
INSERT INTO "turn" VALUES('ada',1);
INSERT INTO "turn" VALUES('bea',2);
CREATE TABLE upload (
	id TEXT NOT NULL,
	workspace TEXT NOT NULL,
	owner TEXT NOT NULL,
	name TEXT NOT NULL,
	kind TEXT NOT NULL,
	size BIGINT NOT NULL,
	sha256 TEXT NOT NULL,
	"offset" BIGINT NOT NULL,
	state TEXT NOT NULL,
	created DOUBLE NOT NULL,
	changed DOUBLE NOT NULL,
	PRIMARY KEY (id)
);
INSERT INTO "upload" VALUES('b2f96b1682c936ee8a61d4f5bdb2cbe6','bennu','ada','a.laz','scan',10,'ab',0,'open',1795473000.5,1795473000.5);
CREATE INDEX job_owner ON job (owner, number);
CREATE INDEX job_workspace ON job (workspace, number);
CREATE UNIQUE INDEX job_key ON job (owner, "key") WHERE key <> '';
CREATE INDEX job_state ON job (state, workspace, solution);
CREATE INDEX dependency_after ON dependency ("after");
CREATE INDEX event_job ON event (job, number);
CREATE INDEX event_workspace ON event (workspace, number);
CREATE INDEX audit_workspace ON audit (workspace, number);
CREATE INDEX upload_workspace ON upload (workspace, created);
COMMIT;
